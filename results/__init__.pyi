from .render.figures import design_figures as design_figures
from .render.figures import draw_figures as draw_figures
