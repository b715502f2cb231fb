from .samples import sample as sample
