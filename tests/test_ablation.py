"""The ablation: which cases, which rows, which numbers."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

import stereopsis as st
from stereopsis.study import ablation, published
from stereopsis.study.ablation import ALL, BASE, LABELS, MEAN, Case, Row
from stereopsis.study.published import COLUMNS, PUBLISHED, Quirks


def sample(name, seed):
    rng = np.random.default_rng(seed)
    wide = rng.integers(0, 256, (16, 34, 3), dtype=np.uint8)
    truth = np.full((16, 30), 4.0, np.float32)
    return SimpleNamespace(name=name, pair=lambda: st.Pair(wide[:, :-4], wide[:, 4:]), truth=lambda: truth)


def rows_of(method, window, **by_case):
    """Rows whose measures all have one value, a list of them a case."""
    quirks = {"base": PUBLISHED, "one": dataclasses.replace(PUBLISHED, wraps=False), "all": Quirks()}
    names = {"base": BASE, "one": LABELS["wraps"], "all": ALL}
    return [
        Row(f"pair {i}", Case(names[key], method, window, quirks[key]), dict.fromkeys(COLUMNS, float(value)))
        for key, values in by_case.items()
        for i, value in enumerate(values)
    ]


def test_cases_switch_off_one_at_a_time_then_all():
    cases = ablation.ablation_cases()
    assert len(set(cases)) == len(cases)
    for method, window in published.TABLES.values():
        base, *single, last = [case for case in cases if (case.method, case.window) == (method, window)]
        assert (base.name, base.quirks) == (BASE, PUBLISHED)
        assert (last.name, last.quirks) == (ALL, Quirks())
        for case in single:
            off = [name for name in Quirks.names() if not getattr(case.quirks, name)]
            assert [LABELS[name] for name in off] == [case.name]
    both = {case.name for case in cases}
    # These have no part in either algorithm's maps.
    assert {LABELS["uint8_squares"], LABELS[MEAN]} == set(LABELS.values()) - both


def test_every_quirk_of_whole_disparities_has_a_label():
    assert set(Quirks.names()) - set(LABELS) == {"slope_subpixel"}


def test_ablate_is_row_after_row():
    samples, told = [sample("a", 1), sample("b", 2)], []
    cases = ablation.ablation_cases()[:2]
    rows = ablation.ablate(samples, told.append, cases)
    assert rows == told
    assert [(row.pair, row.case) for row in rows] == [(s.name, case) for s in samples for case in cases]
    assert rows[3] == ablation.row(samples[1], cases[1])
    assert rows[0].measures == published.score(samples[0], "zncc_smoothed", 30, PUBLISHED)


def test_changes_by_hand():
    found = ablation.changes(rows_of("zncc_smoothed", 30, base=[1, 2, 3], one=[2, 3, 4], all=[2, 2, 8]))
    assert [change.case for change in found[:: len(COLUMNS)]] == [LABELS["wraps"], LABELS[MEAN], ALL]
    assert [change.measure for change in found[: len(COLUMNS)]] == [*COLUMNS]
    one, mean, everything = found[:: len(COLUMNS)]
    # The same change on every pair: no spread.
    assert (one.base, one.mean, one.low, one.high, one.pairs) == (2, 1, 1, 1, (1, 1, 1))
    # The last pair, 3, is a third of the pairs; whichever of 1, 2, 3 comes last gives the interval.
    assert (mean.mean, mean.low, mean.high, mean.pairs) == (1, 1 / 3, 1, ())
    assert (everything.mean, everything.pairs) == (2, (1, 0, 5))
    # Three draws from 1, 0, 5: all of them 0 in 1 of 27 cases, all of them 5 as often; 2.5 % cut neither off.
    assert (everything.low, everything.high) == (0, 5)


def test_interval_is_that_of_many_pairs():
    change = np.random.default_rng(1).normal(1, 2, 400)
    rows = rows_of("zncc_gaussian", 15, base=np.zeros(400), all=change)
    found = ablation.changes(rows)[-1]
    half = 1.96 * change.std() / 20
    assert found.low == pytest.approx(change.mean() - half, abs=0.1 * half)
    assert found.high == pytest.approx(change.mean() + half, abs=0.1 * half)
    assert ablation.changes(rows)[-1] == found


def test_changes_of_what_does_not_belong_together():
    rows = rows_of("zncc", 30, base=[1, 2], all=[1, 2])
    with pytest.raises(ValueError, match="same pairs for 'all corrected' as for 'as published'"):
        ablation.changes(rows[:-1])
    with pytest.raises(ValueError, match="rows must hold 'as published' for zncc at 30"):
        ablation.changes(rows[2:])


def test_markdown():
    rows = rows_of("zncc_smoothed", 30, base=[0.25, 0.75], one=[0.25, 0.25], all=[0.5, 0.75])
    lines = ablation.markdown(ablation.changes(rows)).splitlines()
    assert len(lines) == 2 + 1 + 3
    assert lines[2] == "| nothing: zncc_smoothed, 30 |" + " 50.00 |" * 5 + " 0.50 |"
    minus = "\N{MINUS SIGN}"
    shown = f"{minus}25.00 ({minus}50.00 … +0.00)"
    assert lines[3].startswith(f"| no wrapping round | {shown} |")
    assert lines[5].endswith("| +0.12 (+0.00 … +0.25) |")
    assert all(line.count("|") == 8 for line in lines)
