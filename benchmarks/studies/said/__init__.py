"""Is what others wrote true?  Statements of papers, guides and talks as data, each judged by measured rows."""

from phasebench.benchmarks.studies.said import field_says, printed_numbers
from phasebench.benchmarks.studies.said.talks import statements

STUDIES = (printed_numbers.STUDY, field_says.STUDY, *statements.STUDIES)
