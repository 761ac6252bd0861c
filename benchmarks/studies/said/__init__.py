"""Is what others wrote true?  Statements of papers and guides as data, each judged by measured rows."""

from phasebench.benchmarks.studies.said import field_says, printed_numbers

STUDIES = (printed_numbers.STUDY, field_says.STUDY)
