from expdesign.runfolder.manifest import text_hash


def test_hashes_of_texts_know_their_borders():
    assert text_hash("ab", "c") != text_hash("a", "bc")
    assert text_hash("a") != text_hash("a", "")
    assert text_hash("a", 1) == text_hash("a", 1)
