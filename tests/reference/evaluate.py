"""The definition of the scores, a pixel at a time, in Python's own numbers."""

import math

from reference.fill import background


def measures(errors, truths):
    """Work every measure out of a list of errors (infinite where unanswered) and of the true disparities."""
    n = len(errors)
    if n == 0:
        return None

    def fraction(test):
        return sum(1 for error, true in zip(errors, truths, strict=True) if test(error, true)) / n

    def quantile(percent):
        return min(e for e in errors if 100 * sum(1 for other in errors if other <= e) >= percent * n)

    return {
        "count": n,
        "within_0_25": fraction(lambda e, t: e < 0.25),
        "within_0_5": fraction(lambda e, t: e < 0.5),
        "within_1": fraction(lambda e, t: e < 1),
        "within_2": fraction(lambda e, t: e < 2),
        "within_4": fraction(lambda e, t: e < 4),
        "bad_0_5": fraction(lambda e, t: e > 0.5),
        "bad_1": fraction(lambda e, t: e > 1),
        "bad_2": fraction(lambda e, t: e > 2),
        "bad_4": fraction(lambda e, t: e > 4),
        "d1": fraction(lambda e, t: e > 3 and 100 * e > 5 * abs(t)),
        "epe": sum(errors) / n,
        "rmse": math.sqrt(sum(e * e for e in errors) / n),
        "a50": quantile(50),
        "a90": quantile(90),
        "a95": quantile(95),
        "a99": quantile(99),
    }


def evaluate(disparity, truth, mask=None):
    """Give the measures at own density, over all known pixels, and filled; None over no pixels."""
    filled = background(disparity)
    own, everything, background_filled, answered_truths, truths = [], [], [], [], []
    for y in range(truth.shape[0]):
        for x in range(truth.shape[1]):
            true = float(truth[y, x])
            if not math.isfinite(true) or (mask is not None and not mask[y, x]):
                continue
            answer = float(disparity[y, x])
            filling = float(filled[y, x])
            truths.append(true)
            if math.isfinite(answer):
                own.append(abs(answer - true))
                answered_truths.append(true)
            everything.append(abs(answer - true) if math.isfinite(answer) else math.inf)
            background_filled.append(abs(filling - true) if math.isfinite(filling) else math.inf)
    return measures(own, answered_truths), measures(everything, truths), measures(background_filled, truths)
