"""The verdict of a plan in plain words: how good it is at least, what is foretold, and no more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.report.measured import observers
from symcal.words import listed, number, plural

Content = Mapping[str, Any]

_EXACT = 0.9995
"""Above this a bound is written as 99.9 % and not rounded up to a whole."""


def plan_verdict(content: Content) -> list[str]:
    """Sentences for page one, the most important first.

    Args:
        content: the results dictionary (results.json) of a plan.
    """
    return [_main(content), *_foretold(content), *_compared(content), *_needed(content), _seen(content), *_way(content)]


def percent(share: float) -> str:
    """A share as a percentage, rounded down to a tenth so that a lower bound stays one."""
    return f"{int(min(share, 0.99999) * 1000) / 10:.1f} %"


def efficiencies(content: Content) -> tuple[float | None, float, str]:
    """Lower bounds of the efficiency by the plan's own criterion (None: none is known) and of the D-efficiency, and how
    they are known."""
    plan = content["plan"]
    bound, bound_d = plan["criterion_efficiency_lower_bound"], plan["d_efficiency_lower_bound"]
    proof = plan["certificate"].get("proof")
    how = "searched, not proven"
    if plan["certificate"]["exhaustive"]:
        how = "all of them were looked at"
    elif proof is not None:
        own = bound is not None and plan["criterion"] != "D"
        found = bound if own else bound_d
        proven = proof["criterion_efficiency_lower_bound" if own else "d_efficiency_lower_bound"]
        if proven is not None and proven > found - _LOOSER:
            how = "proven"
            bound, bound_d = proof["criterion_efficiency_lower_bound"], proof["d_efficiency_lower_bound"]
        elif proven is not None:
            how = f"searched; {percent(proven)} are proven"
    return bound, bound_d, how


def _main(content: Content) -> str:
    plan = content["plan"]
    n = plan["poses"]
    pool = content.get("pool")
    which = f"any {n} of the {pool} postures in the pool" if pool else f"any {n} poses"
    which = "any other choice of as many candidates" if content["candidates"] else which
    bound, bound_d, how = efficiencies(content)
    if plan["criterion"] == "D" or bound is None:
        text = f"These {n} poses are at least {percent(bound_d)} as good as {which} can be (D-efficiency, {how})"
        return text + ("." if plan["criterion"] == "D" else f"; for criterion {plan['criterion']} no bound is known.")
    return (
        f"These {n} poses are at least {percent(bound)} as good as {which} can be by criterion {plan['criterion']} "
        f"({how}); their D-efficiency is at least {percent(bound_d)}."
    )


_LOOSER = 1e-3
"""A proven bound that is this much below the searched one does not replace it: both are told."""


def _noise(content: Content) -> str:
    noise, several = content["plan"]["noise"], len(content["measurement"].get("instruments", [])) > 1
    names = {name: each.get("instrument", name) if _touching(content) else name for name, each in noise.items()}
    words = [
        f"{number(each['sigma'])} {each['unit']}{f' ({names[name]})' if several else ''}"
        for name, each in noise.items()
    ]
    return listed(words) if several else " and ".join(words)


def _touching(content: Content) -> bool:
    """Whether all that measures is what is touched."""
    instruments = observers(content)
    return bool(instruments) and all(facts.get("constrains", False) for facts in instruments)


def _foretold(content: Content) -> list[str]:
    plan = content["plan"]
    text = (
        f"With {'contacts of a noise' if _touching(content) else 'measurement noise'} of {_noise(content)} (standard "
        "deviation per axis) they foretell a tool error of "
        f"{number(plan['mean_pose_rms_mm'])} mm rms over the region where accuracy is wanted and "
        f"{number(plan['worst_pose_rms_mm'])} mm at its worst pose."
    )
    out = [text]
    if plan["hidden_mm"] > _NOTICEABLE * plan["mean_pose_rms_mm"]:
        out.append(
            f"Of that, {number(plan['hidden_mm'])} mm rms come from directions that this measurement cannot see, at "
            "their plausible size: more poses of the same kind would not help there."
        )
    return out


_NOTICEABLE = 0.05


def _compared(content: Content) -> list[str]:
    plan, random = content["plan"], content["plan"]["random"]
    if random is None:
        return []
    if random["mean_pose_rms_mm"] is None:
        return [f"Half of all random plans of {plan['poses']} poses leave a direction undetermined."]
    return [
        f"Random plans of as many poses have a D-efficiency of {percent(random['d_efficiency_lower_bound'])} and "
        f"foretell {number(random['mean_pose_rms_mm'])} mm rms and {number(random['worst_pose_rms_mm'])} mm at the "
        f"worst pose (medians of {random['plans']})."
    ]


def _needed(content: Content) -> list[str]:
    promise = content["promise"]
    if promise is None:
        return []
    out = []
    for entry in promise["needed"]:
        figure = "rms" if entry["figure"] == "mean" else "at the worst pose"
        random = (
            f"random ones need about {entry['random']}"
            if entry["random"]
            else "random ones do not get there with any practical number"
        )
        least = (
            "no fewer can do, as far as was searched"
            if entry["at_least"] == entry["poses"]
            else f"fewer than {entry['at_least']} cannot do, whatever the plan, as far as was searched"
        )
        out.append(
            f"{plural(entry['poses'], 'pose')} {'suffice' if entry['poses'] > 1 else 'suffices'} for "
            f"{entry['accuracy_mm']:g} mm {figure} ({least}; {random})."
        )
    return out


def _seen(content: Content) -> str:
    seen = content["identifiability"]
    total, rank = seen["parameters"], seen["rank"]
    if rank == total:
        return f"The plan determines all {total} parameters."
    return f"Of {plural(total, 'parameter')} this measurement can determine {plural(rank, 'combination')}."


def _way(content: Content) -> list[str]:
    order = content["order"]
    lines, joint = order["segments"]["line"], order["segments"]["joint"]
    time = "" if order["time_s"] is None else f" takes {order['time_s']:.0f} s of motion at full joint speeds and"
    return [f"The way through the poses{time} is straight for the tool in {lines} of {lines + joint} segments."]
