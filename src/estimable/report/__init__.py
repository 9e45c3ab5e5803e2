"""A result as one self-contained page: `write_report(report_of(result, ...), path)`."""

from .contents import Chart, Fact, Key, Report, Section, Verdict
from .estimate_page import report_of
from .identification_page import report_of_comparison
from .page import page_of, write_report
from .tuning_page import tuning_report

__all__ = [
    "Chart",
    "Fact",
    "Key",
    "Report",
    "Section",
    "Verdict",
    "page_of",
    "report_of",
    "report_of_comparison",
    "tuning_report",
    "write_report",
]
