"""Which pairs of algorithms differ, when all pairs are asked at once."""

from typing import Literal

import numpy as np
from scipy.stats import false_discovery_control

from railctl.analysis.reliability.curves import Floats

Rule = Literal["tool", "textbook", "bonferroni", "none"]


def differing(p_values: Floats, alpha: float, rule: Rule) -> list[int]:
    """Which of the p-values [pairs] say so, by index.

    textbook: Benjamini & Yekutieli, "The control of the false discovery rate in multiple testing under dependency"
    (2001). tool: what the original makes of it. It compares the i-th smallest p-value with i * alpha / (m * c), c
    being the sum of 1/1 .. 1/i instead of 1/1 .. 1/m, and each for itself, so a larger one may pass where a smaller
    fails. bonferroni: each with alpha / m. none: each with alpha.
    """
    count = len(p_values)
    if count == 0:
        return []
    if rule == "textbook":
        passed = false_discovery_control(p_values, method="by") <= alpha
    elif rule == "tool":
        places = np.arange(1, count + 1)
        thresholds = places / (count * np.cumsum(1 / places)) * alpha
        passed = np.empty(count, bool)
        order = np.argsort(p_values, kind="stable")
        passed[order] = p_values[order] < thresholds
    else:
        passed = p_values < (alpha / count if rule == "bonferroni" else alpha)
    return [int(index) for index in np.flatnonzero(passed)]
