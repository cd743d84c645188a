"""A page as a browser's parser sees it."""

from html.parser import HTMLParser

LOADING = {"src", "href", "srcset", "data", "action", "poster", "background", "xlink:href"}


class Page(HTMLParser):
    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.tags, self.links, self.texts, self.ids = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        if tag == "code":
            self.texts.append("`")
            return
        self.tags.append(tag)
        self.texts.append(" ")
        for name, value in attributes:
            if name in LOADING:
                self.links.append((tag, value))
            if name == "id":
                self.ids.append(value)

    def handle_endtag(self, tag):
        self.texts.append("`" if tag == "code" else " ")

    def handle_data(self, data):
        if self.tags and self.tags[-1] not in ("style", "script"):
            self.texts.append(data)

    @property
    def text(self):
        """With code between backticks."""
        return " ".join("".join(self.texts).split())
