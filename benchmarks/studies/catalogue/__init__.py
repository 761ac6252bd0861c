"""What there is: methods, problems, and tables of coefficients, this project's, a survey's and those of packages."""

from __future__ import annotations

from .acta import STUDY as ACTA
from .coefficients import STUDY as COEFFICIENTS
from .records import METHOD_PAGE, PROBLEM_PAGE
from .tables import STUDY as TABLES

STUDIES = (METHOD_PAGE, PROBLEM_PAGE, COEFFICIENTS, ACTA, TABLES)
