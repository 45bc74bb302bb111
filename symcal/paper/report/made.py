"""Choices of ours, what of the paper has no counterpart, and how the report was made."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.paper.report.blocks import Block, heading, paragraph, row, table
from symcal.words import fixed, number

Content = Mapping[str, Any]


def choices(content: Content) -> list[Block]:
    """Everything that the paper leaves open, with our value."""
    scene, made = content["scene"], content["choices"]
    weights, sound, search, first = made["weights"], made["sound_weights"], made["search"], made["simulation_1"]
    two = content["simulation_2"]
    camera = ", ".join(fixed(v, 0) for v in scene["camera_mm"])
    rows = [
        row("measured point", "the last origin, on which the paper's error model is"),
        row("working area", "[@table_2]; poses and test data uniform in the joints' ranges"),
        row("tour and speeds", "shortest tour found; joint speeds " + ", ".join(_speed(content))),
        row(
            "camera",
            f"{scene['width_px']} × {scene['height_px']} pixels, focal length {number(scene['focal_px'], 4)} px, at "
            f"({camera}) mm, {number(scene['distance_mm'] / 1000)} m from the tool at the initial pose",
        ),
        row("target", f"equilateral triangle, side {number(scene['side_mm'])} mm, its face along x of the last link"),
        row("seen", f"whole target in the image, less than {fixed(scene['incidence_deg'], 0)}° from straight ahead"),
        row("reading of eqs. 10 to 12", next((r["text"] for r in content["readings"] if r["main"]), "–")),
        row("c₁, c₂, c₃", _weights(weights)),
        row("the same in our fitness", _weights(sound)),
        row(
            "genetic algorithm",
            f"{search['population']} plans, {search['bits']} bits per joint; paper: 200 generations, binary",
        ),
        row("plausible errors", "1 mm and 10 mrad unless the robot file says otherwise; they scale the Jacobian"),
        row(
            "damping",
            f"divided or multiplied by {number(first['factor'], 2)}, from the paper's {number(first['damping'], 2)}",
        ),
        row("noise", f"{two['noise']['distribution']}; the paper says random in ±0.1 mm"),
        row("test data", f"{content['measurement']['poses']['test']} poses; the paper does not say how many"),
        row(
            "repetitions",
            f"{two['repetitions']}, with {two['random_plans']} random plans for the predictions; the paper has one",
        ),
    ]
    return [
        heading("Choices of ours"),
        paragraph(
            "The paper is silent on these; the experiment file marks each of them and they can be changed there."
        ),
        table("choices", "Choices of ours", "All others are the paper's.", ["", ""], rows, wide=(1,), left=(0, 1)),
    ]


def _speed(content: Content) -> list[str]:
    joints = content["model"]["ranges"]
    return [
        f"{number(v * 57.29577951308232, 2)}°/s" if j["unit"] == "deg" else f"{number(v)} mm/s"
        for v, j in zip(content["choices"]["speeds"], joints, strict=True)
    ]


def _weights(w: Mapping[str, float]) -> str:
    return f"{number(w['observability'], 2)}, {number(w['angle'], 2)} per rad, {number(w['area'], 2)} per px²"


def counterparts() -> list[Block]:
    """Each of the paper's figures and tables: where it is here, or why not."""
    drawn = [
        ["Fig. 3", "vision set-up", "[@paper_vision]"],
        ["Fig. 5", "optimal trajectory", "[@paper_trajectory]"],
        ["Fig. 6", "motion of each joint", "[@paper_joint_motion]"],
        ["Fig. 7", "convergence", "[@paper_convergence]"],
        ["Fig. 8", "test data", "[@paper_test_data]"],
        ["Fig. 9", "error on the test data", "[@paper_test_errors]"],
    ]
    told = [
        ["Table I", "nominal parameters", "[@table_1]"],
        ["Table II", "ranges of the joints", "[@table_2]"],
        ["Table III", "set errors", "[@table_3]"],
        ["Table IV", "position errors", "[@table_4]"],
        ["Table V", "identified, optimal", "[@table_5]"],
        ["Table VI", "identified, random", "[@table_6]"],
    ]
    return [
        heading("The paper's figures and tables"),
        paragraph(
            "Three figures have no counterpart. Fig. 1 (mechanical structure) and Fig. 2 (link frames) are drawings of "
            "the machine, which a simulation does not have; the frames follow from [@table_1] and its convention. Fig. "
            "4 (procedure of the genetic algorithm) is a flow chart; how the searches went is in [@paper_readings]b."
        ),
        table(
            "counterparts",
            "Counterparts",
            "Where the others are.",
            ["paper", "", "here", "paper", "", "here"],
            [row(*a, *b) for a, b in zip(drawn, told, strict=True)],
            left=(0, 1, 2, 3, 4, 5),
            wide=(1, 4),
        ),
    ]


def made(content: Content) -> list[Block]:
    """Seed, versions, time, inputs."""
    rows = [
        row("random seed", str(content["seed"])),
        row("versions", ", ".join(f"{name} {version}" for name, version in content["versions"].items())),
        row("computing time", ", ".join(f"{_stage(k)} {number(v, 2)} s" for k, v in content["seconds"].items())),
        *(row(path, digest) for path, digest in content["inputs"].items()),
    ]
    return [
        heading("How it was made"),
        table(
            "made",
            "Provenance",
            "The same file and seed give the same numbers; input files with their SHA-256.",
            ["", ""],
            rows,
            left=(0, 1),
            wide=(1,),
        ),
    ]


def _stage(key: str) -> str:
    return key.replace("simulation_1", "Simulation I").replace("simulation_2", "Simulation II").replace("_", " ")
