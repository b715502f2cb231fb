from .page import app as app
from .report import write_report as write_report
