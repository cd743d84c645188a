"""Three studies of a paper, repeated on the digital twin."""
