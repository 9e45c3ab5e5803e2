"""A result as one HTML page that needs no other file: `write_report(report_of(result, ...), path)`."""

from .contents import Chart, Fact, Finding, Key, Report, Section, Table
from .estimate_page import report_of
from .identification_page import report_of_comparison
from .page import page_of, write_report
from .tuning_page import tuning_report

__all__ = [
    "Chart",
    "Fact",
    "Finding",
    "Key",
    "Report",
    "Section",
    "Table",
    "page_of",
    "report_of",
    "report_of_comparison",
    "tuning_report",
    "write_report",
]
