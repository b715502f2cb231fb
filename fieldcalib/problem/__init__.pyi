from .losses import RobustLoss as RobustLoss
