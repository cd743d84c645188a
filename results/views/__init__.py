"""Views: the content that is shown of each stage's result."""
