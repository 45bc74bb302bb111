"""What a check and its plan say, in sentences; from their plain data (`symcal.watch.results`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from symcal.units import in_mrad
from symcal.words import listed, number, plural

Content = Mapping[str, Any]

FRAMES = {"base": "the base, or what measures", "tool": "what is carried: tool or target"}


def size(value: float, unit: str) -> str:
    """A length or an angle with its unit: `0.51 mrad`."""
    shown, factor = in_mrad(unit)
    return f"{number(value * factor, 2)} {shown}"


def share(part: float) -> str:
    """A rate in percent: `1 %`, `0.5 %`."""
    return f"{100 * part:g} %"


def called(name: str, joint: int | None) -> str:
    """A hypothesis in words."""
    if joint is None:
        return FRAMES[name]
    return f"joint {joint}" if name == f"joint_{joint}" else f"joint {joint} '{name}'"


def verdict(content: Content) -> str:
    """The verdict in one sentence."""
    alarm = f"false alarm in {share(content['alpha'])} of checks"
    if content["verdict"] == "holds":
        return f"the calibration holds by {plural(len(content['poses']), 'pose')} ({alarm})"
    group = content["group"]
    if not group:
        return (
            f"changed ({alarm}), and no one change of base, tool or one joint explains it: several of them, a bent "
            f"link, or readings worse than in the calibration ({_over(content, 'before')}); calibrate anew"
        )
    if len(group) == 1:
        return f"changed ({alarm}): {change(group[0])}"
    each = "; or ".join(change(one) for one in group)
    return f"changed ({alarm}), one of these, which these readings do not tell apart: {each}"


def change(one: Content) -> str:
    """What changed by how much."""
    name = called(one["name"], one["joint"])
    if one["joint"] is not None:
        (own,) = one["parameters"].values()
        unit, factor = in_mrad(own["unit"])
        low, high = ((own["value"] + side * own["half_width_95"]) * factor for side in (-1, 1))
        sign = "+" if own["value"] > 0 else ""
        return f"{name} by {sign}{size(own['value'], own['unit'])} (95 %: {number(low, 2)} to {number(high, 2)} {unit})"
    sizes = [size(value, unit) for unit, value in one["size"].items()]
    return f"{name}, by {listed(sizes)}"


def remarks(content: Content) -> Iterator[str]:
    """What a reader of the verdict should know."""
    if content["gross"] is not None:
        yield f"the reading of pose {content['gross']} looks like a slip and was left out: measure it again"
    if content["moved"]:
        yield moved_words(content["unseen"])
    elif content["unseen"]:
        yield f"not seen by these poses, and never claimed: {listed(content['unseen'])}"


def moved_words(unseen: list[str]) -> str:
    """What an instrument that was set up anew cannot tell."""
    which = f" Not seen, and never claimed: {listed(unseen)}." if unseen else ""
    return (
        "the instrument was set up anew: where the base stands is found from these readings, and a joint whose offset "
        f"turns the whole arm (joint 1) is one answer with it.{which}"
    )


def plan_remarks(content: Content) -> Iterator[str]:
    """What a plan finds and what it does not."""
    offsets = content["offsets"]
    state = "moved" if content["moved"] else "still"
    one = [name for name, each in offsets.items() if each["still"] is not None and each["moved"] is None]
    late = {name: each for name, each in offsets.items() if each[state] is None or each[state] > each["wanted"]}
    late = {name: each for name, each in late.items() if state == "still" or name not in one}
    if not late:
        yield "every joint's wanted offset is found"
    for name, each in late.items():
        wanted = size(each["wanted"], each["unit"])
        if each[state] is None:
            yield f"{called(name, each['joint'])} is not seen: the target is on or near its axis"
        elif each["needed"] is None:
            yield (
                f"{called(name, each['joint'])} is not seen at {wanted}, by no number of poses: the calibration does "
                f"not know it better; a target farther off its axis does"
            )
        else:
            yield f"{called(name, each['joint'])} needs {each['needed']} such poses for {wanted}"
    if one:
        yield f"with the instrument set up anew, {listed(one)} and the base are one answer"


def _over(content: Content, state: str) -> str:
    values = content["over_noise"][state]
    rms = (sum(v * v for v in values) / max(len(values), 1)) ** 0.5
    return f"{number(rms, 2)} times its noise"
