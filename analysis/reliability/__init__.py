"""Reliability of learning curves, after Chan et al. (2020), exactly as their open tool computes it.

How far do returns scatter within a run (DT) and across runs (DR)? How deep do they fall from one point to the next
(SRT), and from the best so far (LRT)? Algorithms are ranked by it, with intervals and tests: `docs/reliability.md`.
"""

from railctl.analysis.reliability.curves import Curves, CurvesError
from railctl.analysis.reliability.document import judge
from railctl.analysis.reliability.sensitivity import sensitivity
from railctl.analysis.reliability.switches import MAIN, RECORDS, Switches, parse_switches

__all__ = ["MAIN", "RECORDS", "Curves", "CurvesError", "Switches", "judge", "parse_switches", "sensitivity"]
