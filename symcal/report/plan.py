"""The report of a plan as text: results in, strings for the template out.

Nothing is computed here but units and rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from symcal.report.measured import noise_phrase, observers_named
from symcal.report.plan_verdict import percent, plan_verdict
from symcal.words import listed, number, plural

Content = Mapping[str, Any]

_METHODS = {
    "certified": "exchange, refinement, and both again with the poses of an optimal design",
    "combined": "exchange over a sample of poses, then refinement with exact derivatives",
    "exchange": "greedy choice and exchange over a sample of poses",
    "refine": "random plans refined with exact derivatives",
    "genetic": "genetic algorithm on whole plans",
    "random": "poses at random",
}
_OVER_A_SET = ("certified", "combined", "exchange")
"""Methods that are the same where poses are chosen from a finite set."""
_CRITERIA = {
    "D": "D: determinant of the information (product of all precisions)",
    "A": "A: sum of the variances of the scaled parameters",
    "E": "E: variance of the worst seen direction",
    "cond": "condition number of the scaled Jacobian",
    "I": "I: mean predicted error over the region",
    "G": "G: largest predicted error over the region",
    "J": "J: predicted error over the region from noise and from errors that the model lacks",
}


def plan_text(content: Content) -> dict[str, Any]:
    """Everything that the template `plan` prints, by section.

    Args:
        content: the results dictionary (results.json) of a plan.
    """
    return {
        "title": content.get("title") or content["name"],
        "subtitle": _subtitle(content),
        "version": content["versions"].get("symcal", ""),
        "verdict": plan_verdict(content),
        "warnings": list(content["warnings"]),
        "comparison": _comparison(content),
        "bounds": _bounds(content),
        "unseen": [entry["text"].replace("-", "\N{MINUS SIGN}") for entry in content["identifiability"]["unseen"]],
        "promise": "How many poses" if content["promise"] is not None else "What is foretold",
        "needed": _needed(content),
        "instruments": _instruments(content),
        "methods": _methods(content),
        "constraints": _constraints(content),
        "way": _way(content),
        "facts": _facts(content),
        "inputs": [[path, digest] for path, digest in content["inputs"].items()],
    }


def _subtitle(content: Content) -> str:
    robot, measurement = content["robot"], content["measurement"]
    points = measurement["points"]
    of_points = f" of {plural(len(points), 'point')}" if len(points) > 1 else ""
    unknown = f", {listed(measurement['estimate'])} unknown" if measurement["estimate"] else ""
    return (
        f"{robot['name']}: {plural(robot['dof'], 'joint')}, {robot['convention']} link convention. "
        f"A plan for {_read(measurement)}{of_points}{unknown}."
    )


def _read(measurement: Content) -> str:
    """What is measured; with several instruments every one of them."""
    instruments = measurement.get("instruments", [])
    if len(instruments) < 2:
        return f"{measurement['type']} measurements"
    return observers_named(instruments)


def _comparison(content: Content) -> dict[str, Any]:
    plan, random = content["plan"], content["plan"]["random"]
    rows: list[tuple[str, str, Callable[[float], str]]] = [
        ("D-efficiency, at least", "d_efficiency_lower_bound", percent),
        ("worst-pose (G) efficiency", "g_efficiency", percent),
        ("rms over the region / mm", "mean_pose_rms_mm", number),
        ("at its worst pose / mm", "worst_pose_rms_mm", number),
    ]
    own = plan["criterion_efficiency_lower_bound"]
    made: list[list[str]] = []
    for label, key, shown in rows:
        cells = [shown(plan[key])]
        if random is not None:
            cells.append("–" if random[key] is None else shown(random[key]))
        made.append([label, *cells])
    if plan["criterion"] not in ("D", "O1"):
        cells = ["none known" if own is None else percent(own), *(["–"] if random is not None else [])]
        made.insert(0, [f"efficiency by criterion {plan['criterion']}, at least", *cells])
    proof = plan["certificate"].get("proof")
    if proof is not None:
        proven = {"D-efficiency, proven": "d_efficiency_lower_bound"}
        if plan["criterion"] not in ("D", "O1"):
            proven[f"efficiency by criterion {plan['criterion']}, proven"] = "criterion_efficiency_lower_bound"
        proven["worst-pose (G) efficiency, proven"] = "g_efficiency_lower_bound"
        blank = ["–"] if random is not None else []
        shown_as = {label: proof[key] for label, key in proven.items() if proof[key] is not None}
        for label, share in shown_as.items():
            what = label.removesuffix(", proven")
            beside = next(i for i, row in enumerate(made) if row[0].startswith(what))
            made[beside][0] = f"{made[beside][0]} (searched)"
            made.insert(beside + 1, [label, percent(share), *blank])
    head = [f"this plan, {plural(plan['poses'], 'pose')}"]
    if random is not None:
        head.append(f"median of {random['plans']} random plans")
    return {"head": head, "rows": made}


def _bounds(content: Content) -> str:
    plan, seen = content["plan"], content["identifiability"]
    how = _how(content)
    text = (
        "The D-efficiency compares the information of the plan, as a geometric mean over all directions, with an upper "
        "bound for any plan, by the equivalence theorem of optimal design: a plan with half the efficiency needs twice "
        f"the poses for the same precision. The maximum behind the bound is {how} The worst-pose efficiency is "
        "another figure: how near the largest variance of a foretold measurement over the feasible poses is to the "
        f"smallest possible one. The plan speaks about {plan['rank']} of "
        f"{plural(seen['parameters'], 'parameter direction')}"
    )
    hidden = seen["parameters"] - seen["rank"]
    if not hidden:
        return text + ": all of them."
    return text + (
        f"; {hidden} cannot be seen by any plan of this measurement at this noise, and an identification will leave "
        f"{'it' if hidden == 1 else 'them'} near nominal:"
    )


def _how(content: Content) -> str:
    """How the maximum behind the bounds was found, and what is proven of it; a sentence's end, or more."""
    certificate, pool = content["plan"]["certificate"], content.get("pool")
    if certificate["exhaustive"]:
        if pool and not content["candidates"]:
            touching = content["touching"]
            which = "random ones moved until they touch" if touching else "random ones and corners of the area"
            every = "posture that could touch" if touching else "posture of the area"
            said = f"over all {certificate['searched']} postures of a pool, {which}"
            return f"{said}: it holds for this pool, not for every {every}."
        return f"over all {certificate['searched']} candidates, which are the whole set."
    searched = (
        f"searched over {certificate['searched']} sampled poses, limits and corners among them, and polished with "
        "exact derivatives"
    )
    proof = certificate.get("proof")
    if proof is None:
        why = f": {certificate['unproven']}" if certificate.get("unproven") else ""
        return f"{searched}; it holds up to what such a search misses and is not proven{why}."
    text = (
        f"{searched}. It is also proven over the whole working area, which {plural(proof['joints'], 'joint')} of the "
        f"arm decide{'s' if proof['joints'] == 1 else ''}: what is maximised is a polynomial of their sines, cosines "
        f"and lengths, and in {proof['boxes']} boxes it is nowhere larger by more than 0.01 %, rounding included."
    )
    if proof["open_share"]:
        text += (
            f" In {100 * proof['open_share']:.2g} % of the area it may be larger than what was to be proven; the "
            "proven figures hold all the same."
        )
    if content["constraints"]["feasible_share_of_each_alone"]:
        text += " Constraints are left out of the proof, which makes it loose, never wrong."
    if proof["missed"]:
        text += f" The proof met {plural(proof['missed'], 'pose')} that the search had missed."
    return text


def _needed(content: Content) -> list[list[str]]:
    promise = content["promise"]
    if promise is None:
        return []
    return [
        [
            f"{entry['accuracy_mm']:g} mm {'rms' if entry['figure'] == 'mean' else 'at the worst pose'}",
            str(entry["poses"]),
            str(entry["at_least"]),
            str(entry["random"]) if entry["random"] else "–",
        ]
        for entry in promise["needed"]
    ]


def _instruments(content: Content) -> list[list[str]]:
    """The same poses measured by sets of instruments: seen directions and foretold errors."""
    return [
        [
            " + ".join(each["instruments"]),
            "–" if each["refused"] else f"{each['rank']} of {each['parameters']}",
            "–" if each["mean_mm"] is None else number(each["mean_mm"]) + ("*" if each["aligned"] else ""),
            "–" if each["worst_mm"] is None else number(each["worst_mm"]) + ("*" if each["aligned"] else ""),
            each["refused"],
        ]
        for each in content.get("instruments", [])
    ]


def _methods(content: Content) -> list[list[str]]:
    if len(content["methods"]) < 2:
        return []
    return [
        [
            name,
            percent(facts["d_efficiency_lower_bound"]),
            percent(facts["g_efficiency"]),
            number(facts["mean_pose_rms_mm"]),
            number(facts["worst_pose_rms_mm"]),
            number(facts["search_seconds"], 2),
        ]
        for name, facts in content["methods"].items()
    ]


def _constraints(content: Content) -> list[list[str]]:
    shares = content["constraints"]
    rows = [[name, percent(share)] for name, share in shares["feasible_share_of_each_alone"].items()]
    return [*rows, ["all together", percent(shares["feasible_share"])]] if rows else []


def _way(content: Content) -> str:
    order = content["order"]
    segments = order["segments"]
    text = (
        "The poses stand in the order of a short tour in joint time (nearest neighbour, then exchanges until none "
        "helps; not proven shortest). The tool moves straight wherever the arm can follow within its limits: in "
        f"{segments['line']} of {sum(segments.values())} segments."
    )
    if order["no_line_because"]:
        reasons = [f"{why} ({count})" for why, count in order["no_line_because"].items()]
        text += f" In the others the joints move linearly because {listed(reasons)}."
    if order["time_s"] is not None:
        text += f" Motion at full joint speeds, without acceleration and measuring, takes {order['time_s']:.0f} s."
    text += (
        " Constraints are checked for the line through the links, on the way too; that the arm does not touch itself "
        "is not checked."
    )
    if order["required"]:
        text += f" Required: pose {listed([str(name) for name in order['required']])}."
    return text


def _facts(content: Content) -> list[list[str]]:
    plan = content["plan"]
    noise = [noise_phrase(name, each, content) for name, each in plan["noise"].items()]
    choice = "the pool" if content.get("pool") else "the candidates"
    finite = bool(content["candidates"] or content.get("pool")) and plan["method"] in _OVER_A_SET
    how = f"greedy choice and exchange over {choice}" if finite else _METHODS[plan["method"]]
    facts = [
        ["method", f"{plan['method']}: {how}"],
        ["criterion", _CRITERIA.get(plan["criterion"], f"observability index {plan['criterion']}")],
        ["task region", f"{content['region']}, uniform in joint space"],
        ["noise planned with", f"standard deviation {listed(noise)}"],
        ["search", f"{number(plan['search_seconds'], 2)} s with the certificate"],
    ]
    if content["candidates"]:
        facts.append(["candidates", f"{content['candidates']} poses to choose from"])
    elif content.get("pool"):
        touching = " that touch" if content["touching"] else ""
        facts.append(["pool", f"{content['pool']} postures{touching}, to choose from"])
    if content["constraints"]["distance"]:
        facts.append(["distance", f"{content['constraints']['distance']:g} of the working area between any two poses"])
    facts.append(["random seed", str(content["seed"])])
    facts.append(["versions", ", ".join(f"{name} {version}" for name, version in content["versions"].items())])
    return facts
