"""What the paper could not see: unseen directions, chance, and what its fitness does."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.report.paper.blocks import Block, at_least, bullets, figures, heading, paragraph, percent, row, span, table
from symcal.report.paper.plans import PLAN_LABELS
from symcal.words import MINUS, fixed, listed, number, plural, symbol

Content = Mapping[str, Any]

_REASONS = {
    frozenset({"theta_5"}): "a₅ = 0 puts the last origin on the axis of the last joint; turning about an axis moves no "
    "point on it.",
    frozenset({"theta_4", "a_4"}): "d₅ = 25 mm stands across the elbow's axis; a small turn of the elbow moves its end "
    "along x, and so does a₄.",
    frozenset({"alpha_4", "d_4"}): "tilting the last 25 mm moves their end along the elbow's axis, and so does d₄.",
    frozenset({"alpha_4", "d_3"}): "tilting the last 25 mm moves their end along the elbow's axis, and so does d₃.",
    frozenset({"d_3", "d_4"}): "reach and elbow have parallel axes: an offset may sit in either.",
}
_METHODS = {"unregularised": "all free, as in the paper", "minimum_norm": "minimum norm", "priors": "priors"}


def unseen(content: Content) -> list[Block]:
    """Rank, directions, and what to do about them."""
    gauge = content["gauge"]
    nominal, truth, target = gauge["nominal"], gauge["truth"], gauge["three_target_points"]
    items = [_direction(entry) for entry in nominal["unseen"]]
    left = nominal["parameters"] - nominal["rank"]
    return [
        heading("What the paper could not see: the parameters"),
        paragraph(
            f"At the noise of Simulation II the data determine {nominal['rank']} of {nominal['parameters']} directions "
            "in the space of the error parameters better than a plausible error (1 mm, 10 mrad); the other "
            f"{left} do not change any measured position at nominal. At the true errors they do, by so little that the "
            f"rank at this noise is {truth['rank']} all the same ([@paper_spectra]). The paper's sentence that all "
            "error parameters are well solved therefore cannot hold, whatever the trajectory:"
        ),
        bullets(items),
        *_table_v(content),
        figures("paper_spreads"),
        paragraph(
            "What helps is not another trajectory. Either the parameters are kept near nominal where nothing is known "
            "of them, by minimum norm or by priors, which costs no accuracy ([@methods]); or more is measured: all "
            f"three points of the paper's own target instead of one show {target['rank']} of {target['parameters']}"
            + (f", and only {_names(target['unseen'][0])} stay together." if len(target["unseen"]) == 1 else ".")
        ),
        _methods(content),
        figures("paper_spectra"),
    ]


def _direction(entry: Mapping[str, Any]) -> tuple[str, str]:
    names = list(entry["direction"])
    text = entry["text"]
    _, _, amounts = text.partition(": ")
    for name in sorted(names, key=len, reverse=True):
        amounts = amounts.replace(name, symbol(name))
    reason = _REASONS.get(frozenset(names), "")
    words = f"{amounts.replace(' -', f' {MINUS}').removeprefix('-')}. " if amounts else ""
    words = words[:1].upper() + words[1:]
    lead = f"{symbol(names[0])}." if len(names) == 1 else f"{listed([symbol(n) for n in names])}."
    return lead, (words + reason[:1].upper() + reason[1:]).strip() or f"{text}."


def _names(entry: Mapping[str, Any]) -> str:
    return listed([symbol(name) for name in entry["direction"]])


def _table_v(content: Content) -> list[Block]:
    """Why the paper's identified values are no finding there."""
    paper = content["simulation_2"]["paper"]["optimal"]
    judged, table_v = paper["parameters_at_our_test_poses"], paper["parameters"]
    if not judged or not {"alpha_4", "theta_5", "d_3", "d_4"} <= set(table_v):
        return []
    along = 25.0 * table_v["alpha_4"]
    total = table_v["d_3"] + table_v["d_4"]
    true = {n: p["true_error"] for n, p in content["simulation_1"]["parameters"].items()}
    reduced = content["printed"]["optimal"]["reduced"]
    return [
        paragraph(
            f"Δα₄ = {fixed(table_v['alpha_4'], 4)} rad moves the end of the last 25 mm by {fixed(along, 2)} mm along "
            f"the elbow's axis, Δd₃ + Δd₄ = {fixed(total, 2)} mm move it back: {fixed(total + along, 2)} mm of each "
            f"other are left, where the true robot has {fixed(true['d_3'] + true['d_4'] + 25.0 * true['alpha_4'], 2)}. "
            f"Δθ₅ = {fixed(table_v['theta_5'], 4)} rad turns a frame about its own origin. These are no findings about "
            "the robot. Without their unseen part the paper's values are "
            f"Δα₄ = {fixed(reduced['alpha_4'], 4)}, Δθ₅ = {fixed(reduced['theta_5'], 4)} rad, Δd₃ = "
            f"{fixed(reduced['d_3'], 3)} and Δd₄ = {fixed(reduced['d_4'], 3)} mm ([@table_5]), and predict the same "
            "positions. An offset typed into a controller from Table V would be harmless where the point is measured "
            "and wrong for every tool that is longer, and for its orientation by up to "
            f"{fixed(abs(table_v['alpha_4'] - true['alpha_4']) * 57.29577951308232, 1)}°.",
            lead="Table V.",
        )
    ]


def _methods(content: Content) -> Block:
    gauge = content["gauge"]
    rows = []
    for key, label in _METHODS.items():
        entry = gauge["methods"][key]
        spread = {name: entry["sd"][name] for name in entry["sd"]}
        cells = [
            span(entry["true_rms_mm"]),
            number(entry["true_rms_over_cramer_rao"]),
            *(
                number(spread[name], 2) if name in spread else "–"
                for name in ("theta_5", "alpha_4", "a_4", "d_3", "d_4")
            ),
        ]
        rows.append(row(label, *cells, strong=key == "minimum_norm"))
    return table(
        "methods",
        "Three ways to treat what is not seen",
        f"Over {gauge['repetitions']} draws of the noise on the certified plan: rms error against truth (median and 5 "
        "to 95 %, mm), relative to the Cramér–Rao bound of the identifiable directions, and standard deviation of the "
        "parameters that the paper reports (rad, mm).",
        ["", "error against truth", "over bound", "θ₅", "α₄", "a₄", "d₃", "d₄"],
        rows,
        groups=[("", 3), ("standard deviation", 5)],
    )


def chance(content: Content) -> list[Block]:
    """Distributions over repetitions: how often which plan wins, and by how much."""
    two, wins = content["simulation_2"], content["wins"]
    names = (*PLAN_LABELS, "new_random")
    labels = {**PLAN_LABELS, "random": "one random plan", "new_random": "a new random plan"}
    rows = []
    for name in names:
        again = two["new_random"] if name == "new_random" else two["plans"][name]["repetitions"]
        rows.append(
            row(
                labels[name],
                span(again["measured_mean_mm"]),
                span(again["true_rms_mm"]),
                number(content["cramer_rao_rms_mm"][name]),
                number(content["over_cramer_rao"][name]),
                *("–" if other == name else percent(wins[name][other], 0) for other in ("paper_ga", "new_random")),
                strong=name == "certified",
            )
        )
    best, other = two["plans"]["certified"]["repetitions"], two["new_random"]
    true = 1 - best["true_rms_mm"]["median"] / other["true_rms_mm"]["median"]
    seen = 1 - best["measured_mean_mm"]["median"] / other["measured_mean_mm"]["median"]
    return [
        heading("What the paper could not see: chance"),
        paragraph(
            f"The paper shows one draw of the noise on one random trajectory. Over {two['repetitions']} draws the "
            f"certified plan's error against truth is {percent(true, 0)} smaller than a new random plan's in the "
            f"median, which against noisy test data looks like {percent(seen, 1)}; it wins in "
            f"{percent(wins['certified']['new_random'])} of the draws and loses in the others. With minimum norm in "
            "the unseen directions all plans reach their Cramér–Rao bound: what is left between plans is the plans, "
            "not the solver."
        ),
        table(
            "repetitions",
            f"{two['repetitions']} repetitions",
            "Median and 5 to 95 %, mm. Bound: least rms error over the test poses that any unbiased identification of "
            "the seen directions can have, sqrt of the mean of tr(J C Jᵀ). Wins: share of the repetitions with the "
            "smaller error against truth than the plan by the paper's fitness (p) or a new random plan (r).",
            ["plan", "mean, measured", "rms, truth", "bound", "rms over bound", "wins p", "wins r"],
            rows,
        ),
    ]


def fitness(content: Content) -> list[Block]:
    """The readings of the paper's fitness side by side."""
    readings, found = content["readings"], content["plans"]
    two = content["simulation_2"]
    random = two["random_expected_rms_mm"]
    losing = [r for r in readings if r["beats_random_expected"] < 0.5]
    main = next((r for r in readings if r["main"]), readings[0])
    scores = main["scores"]
    weights = content["choices"]["weights"]
    rows = [
        row(
            entry["text"] + (" (the experiment's)" if entry["main"] else ""),
            number(entry["expected_rms_mm"]),
            percent(entry["beats_random_expected"], 1),
            at_least(entry["d_efficiency_lower_bound"]),
            str(entry["distinct_poses"]),
            strong=entry["main"],
        )
        for entry in readings
    ]
    rows += [
        row(
            f"ours: {PLAN_LABELS[name]}",
            number(found[name]["expected_rms_mm"]),
            percent(found[name]["beats_random_expected"], 1),
            at_least(found[name]["d_efficiency_lower_bound"]),
            "",
            rule=name == "ga",
        )
        for name in ("ga", "certified")
    ]
    searched = (
        f"It is not the search that fails: by its own fitness the plan found has {number(scores['paper_ga'])}, the "
        f"certified plan {number(scores['certified'])}, the random one {number(scores['random'])} (smaller is better). "
        if scores["paper_ga"] <= min(scores.values())
        else ""
    )
    return [
        heading("What the paper could not see: its fitness"),
        paragraph(
            "Equations 10 to 12 leave open whether a condition number is of one pose or of the whole trajectory, "
            "which columns it runs over and in which units, and the weights. We tried several readings with c₁ = "
            f"{number(weights['observability'], 2)}, c₂ = {number(weights['angle'], 2)} per rad and c₃ = "
            f"{number(weights['area'], 2)} per px² (ours), all over the identifiable columns: over all fifteen at "
            f"nominal the condition number is infinite. {len(losing)} of {plural(len(readings), 'reading')} lead to "
            f"plans that predict larger errors than the median random plan ({number(random['median'])} mm). "
            f"{searched}The fitness asks for the wrong thing: a condition number near one means that all directions "
            "are known equally well, or equally badly. Taken per pose, it is best to repeat the one best-conditioned "
            "pose, which tells the same thing again and again; taken over the trajectory, it gives up what is easily "
            "known to balance what is hard to know. Relative to what an average pose of the working area tells, it "
            "becomes sensible. In fairness: the paper does not give its weights, camera or trajectory, its own reading "
            "may have been a better one, and its comparison with random points came out in its favour."
        ),
        table(
            "readings",
            "Readings of the paper's fitness",
            "Each searched by the same genetic algorithm. Predicted: rms position error over the test poses from "
            f"noise alone, mm. Random plans: {two['random_plans']}. Distinct: poses that differ by more than a "
            "hundredth of the working area from each other.",
            ["reading", "predicted", "beats random", "D-efficiency", "distinct"],
            rows,
        ),
        figures("paper_readings"),
    ]
