"""Views, figures and reports of results; they compute nothing that a run decides.

Its public names are imported on their first use: a report whose figures exist needs no plotting
library.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
