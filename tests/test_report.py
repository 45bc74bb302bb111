"""The report: a PDF with the right numbers, whatever the names are."""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path
from typing import Any

import pytest
from identifications import content_of, simulated, wired

from symcal import plots
from symcal.calibration.decision import Decision
from symcal.calibration.reasons import Reason
from symcal.calibration.tolerance import Tolerance
from symcal.errors import InputError
from symcal.plots.save import save_figures
from symcal.report import Picture, verdict, write_report
from symcal.report.identification import identification_text
from symcal.report.learnt import learnt_and_assumed
from symcal.words import number

NASTY = '#set page(fill: red) $x$ *b* _i_ [c] <l> @r \\ "q" // `raw` 日本 Ωµ ' + "very_long" * 30


@pytest.fixture(scope="module")
def case(configs: Path) -> Any:
    return simulated(configs, "pose")


@pytest.fixture(scope="module")
def content(case: Any) -> dict[str, Any]:
    return content_of(*case)


@pytest.fixture(scope="module")
def pictures(case: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[Picture, ...]:
    return save_figures(plots.identification_figures(*case), tmp_path_factory.mktemp("report") / "figures")


def _text(path: Path) -> str:
    pypdf = pytest.importorskip("pypdf", reason="pypdf, which reads PDF files back, is not installed")
    return " ".join("\n".join(page.extract_text() for page in pypdf.PdfReader(path).pages).split())


def test_page_one_has_the_decision(content: dict[str, Any], tmp_path: Path) -> None:
    """In a box of its own, and not once more among verdict and warnings."""
    tolerance = Tolerance(0.05)
    reasons = (Reason("position", "on the test poses [it] is too far off"), Reason("unsettled", "it did not converge"))
    for decision in (Decision(tolerance, reasons, "", ("few poses judge",)), Decision(None, (), "it is better")):
        found = {**content, "decision": decision.facts, "warnings": ["it did not converge", "a warning"]}
        write_report(found, (), tmp_path / "report.pdf")
        page = _text(tmp_path / "report.pdf")
        assert page.count("It did not converge.") == 1  # as a reason, or as a warning
        assert "it did not converge" not in page
        assert ("On the test poses [it] is too far off." in page) != decision.accepted
        assert ("Refused" in page, "Accepted" in page) == (not decision.accepted, decision.accepted)
        assert "A warning." in page


def test_pdf_has_the_numbers(content: dict[str, Any], pictures: tuple[Picture, ...], tmp_path: Path) -> None:
    path = tmp_path / "report.pdf"
    write_report(content, pictures, path)
    assert path.read_bytes().startswith(b"%PDF")
    text = _text(path)
    for part in ("train", "test", "truth"):
        for state in ("before", "offsets_only", "after"):
            assert f"{content['accuracy'][part][state]['position_mm']['rms']:.3g}"[:4] in text
    assert f"{content['identifiability']['rank']} of {content['identifiability']['parameters']} are seen" in text
    assert f"{content['identification']['effective_parameters']:.1f} parameters' worth" in text
    for picture in pictures:
        assert picture.title in text
    for name in content["identification"]["parameters"]:
        assert name in text


def test_report_needs_no_picture(content: dict[str, Any], tmp_path: Path) -> None:
    write_report(content, (), tmp_path / "report.pdf")
    assert (tmp_path / "report.pdf").stat().st_size > 10_000


def test_special_characters_are_text(content: dict[str, Any], tmp_path: Path) -> None:
    nasty = copy.deepcopy(content)
    nasty |= {"title": NASTY, "name": NASTY, "warnings": [NASTY, NASTY], "inputs": {NASTY: "0" * 64}}
    nasty["robot"]["name"] = NASTY
    nasty["frames"]["points_mm"] = {NASTY: [1.0, 2.0, 3.0]}
    nasty["identification"]["parameters"]["tool_" + NASTY] = {
        "nominal": 0.0,
        "error": 1.0,
        "identified": 1.0,
        "sigma": 0.5,
        "half_width_95": 1.0,
        "learnt": 0.3,
        "unit": "mm",
        "free": True,
    }
    nasty["identifiability"]["unseen"] = [{"direction": {"a_1": 1.0}, "text": NASTY}]
    path = tmp_path / "report.pdf"
    write_report(nasty, (), path)
    text = _text(path).replace("\u200b", "")
    assert "#set page(fill: red) $x$ *b* _i_ [c] <l> @r" in text


def test_outliers_and_the_loss_are_told(content: dict[str, Any], tmp_path: Path) -> None:
    assert identification_text(content)["outliers"] is None
    assert dict(identification_text(content)["facts"])["loss"].startswith("linear")
    odd = copy.deepcopy(content)
    one = {"pose": "tilt_7", "instrument": "pose", "quantity": "position", "group": "position", "point": ""}
    one |= {
        "off": 48.3,
        "unit": "mm",
        "noises": 912.0,
        "weight": 0.0,
        "parameter": "d_4",
        "sigmas": -1.7,
        "tool_mm": 0.21,
    }
    odd["outliers"] = [one] * 15
    odd["identification"] |= {"loss": "tukey", "loss_choice": {"why": "it foretells held-out poses clearly better"}}
    write_report(odd, (), tmp_path / "report.pdf")
    text = _text(tmp_path / "report.pdf").replace("\u200b", "")
    for words in ("tilt_7", "48.3 mm", "912", "d₄ −1.7", "0.21 mm", "15 readings that the noise", "3 more are in"):
        assert words in text
    assert "Chosen by cross-validation: it foretells" in text


def test_four_hundred_parameters_go_over_pages(content: dict[str, Any], tmp_path: Path) -> None:
    many = copy.deepcopy(content)
    entry = next(iter(many["identification"]["parameters"].values()))
    many["identification"]["parameters"] = {f"theta_{i}": entry for i in range(400)}
    write_report(many, (), tmp_path / "report.pdf")
    text = _text(tmp_path / "report.pdf")
    assert text.count("name in files") > 5  # the header stands on every page


def test_a_folder_that_is_not_there_is_an_error_of_the_input(content: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        write_report(content, (), tmp_path / "none" / "report.pdf")


def test_text_is_plain_data(content: dict[str, Any]) -> None:
    text = identification_text(json.loads(json.dumps(content)))
    assert json.loads(json.dumps(text, allow_nan=False)) == text


def test_parameters_in_deg_and_mm(content: dict[str, Any]) -> None:
    rows = {row["name"]: row for row in identification_text(content)["parameters"]["rows"]}
    for name, p in content["identification"]["parameters"].items():
        row = rows[name]
        factor = 180 / math.pi if p["unit"] == "rad" else 1.0
        shown = {key: float(row[key].replace("−", "-")) for key in ("nominal", "error", "identified")}
        decimals = len(row["error"].partition(".")[2])
        assert row["unit"] == ("deg" if p["unit"] == "rad" else "mm")
        for key, value in shown.items():
            assert value == pytest.approx(p[key] * factor, abs=0.51 * 10.0**-decimals)
        assert float(row["sigma"]) == pytest.approx(p["sigma"] * factor, rel=0.06)
        assert 0 <= 100 * p["learnt"] - float(row["learnt"].partition("\u00a0")[0]) < 1 + 1e-9 or p["learnt"] > 0.9999
        assert row["state"] == ("learnt" if p["learnt"] >= 0.5 else "assumed")


def test_assumed_and_fixed_rows_are_told_apart(content: dict[str, Any]) -> None:
    case = copy.deepcopy(content)
    case["identification"]["parameters"] = {
        "theta_1": {"nominal": 0.0, "error": 0.0, "identified": 0.0, "unit": "rad", "free": False}
        | dict.fromkeys(("sigma", "half_width_95", "learnt")),
        "a_1": _parameter(0.499),
        "a_2": _parameter(0.5),
    }
    table = identification_text(case)["parameters"]
    assert [row["state"] for row in table["rows"]] == ["fixed", "assumed", "learnt"]
    assert [row["learnt"].replace("\u00a0", " ") for row in table["rows"]] == ["–", "49 %", "50 %"]
    notes = " ".join(table["notes"])
    assert "mostly assumed" in notes
    assert "held at nominal" in notes


def _parameter(learnt: float) -> dict[str, Any]:
    numbers = {"nominal": 100.0, "error": 0.1, "identified": 100.1, "sigma": 0.2, "half_width_95": 0.4}
    return {**numbers, "learnt": learnt, "unit": "mm", "free": True}


def test_what_was_learnt_counts_the_link_parameters_alone() -> None:
    held = _parameter(0.9) | {"free": False}
    parameters = {"a_1": _parameter(0.9), "a_2": _parameter(0.1), "a_3": held, "base_x": _parameter(1.0)}
    text = learnt_and_assumed(parameters)
    assert text.startswith("Of 2 free link parameters 1 ")
    assert "a₂" in text
    assert "a₁" not in text
    assert learnt_and_assumed({"a_1": _parameter(0.9)}).startswith("Every free link parameter (1 in all)")
    assert learnt_and_assumed({"base_x": _parameter(1.0), "a_1": held}) == ""
    many = learnt_and_assumed({f"a_{i}": _parameter(0.0) for i in range(1, 41)})
    assert "30 more" in many


def test_a_fit_that_did_not_converge_must_not_be_used(content: dict[str, Any], tmp_path: Path) -> None:
    case = copy.deepcopy(content)
    case["identification"] |= {"converged": False, "message": "stopped: it swings"}
    first = verdict(case)[0]
    assert "Do not use these numbers" in first
    assert "stopped: it swings" in first
    assert not any("Do not use" in sentence for sentence in verdict(content))
    write_report(case, (), tmp_path / "report.pdf")
    assert "Do not use these numbers" in _text(tmp_path / "report.pdf")


@pytest.mark.parametrize(
    ("factor", "estimated", "words"),
    [
        (1.6, True, "larger than"),
        (0.4, True, "smaller than"),
        (1.05, True, "about as large"),
        (1.0, False, "as stated"),
    ],
)
def test_the_factor_on_the_sizes_is_explained(
    content: dict[str, Any], factor: float, estimated: bool, words: str
) -> None:
    found = content["identification"] | {"scale_factor": factor, "scale_factor_estimated": estimated}
    facts = dict(identification_text(content | {"identification": found})["facts"])
    assert words in facts["sizes"]
    assert facts["degrees of freedom"].startswith(f"{found['dof']:.1f}: {found['equations']} equations less ")


def _accuracy(before: float, after: float) -> dict[str, Any]:
    def state(rms: float) -> dict[str, Any]:
        return {"position_mm": {"mean": rms, "rms": rms, "p95": 2 * rms, "max": 3 * rms, "count": 57}}

    return {"before": state(before), "after": state(after)}


@pytest.mark.parametrize(
    ("before", "after", "words", "useless"),
    [(3.84, 1.38, "fell from 3.84", False), (4.74, 5.21, "rose from 4.74", True), (1.0, 0.99, "hardly changed", True)],
)
def test_verdict_says_what_happened(
    content: dict[str, Any], before: float, after: float, words: str, useless: bool
) -> None:
    case = content | {"accuracy": {"train": _accuracy(9.0, 0.1), "test": _accuracy(before, after)}}
    first, second = verdict(case)[:2]
    assert words in first
    assert f"{number(after)} mm rms on 12 held-out poses" in first
    assert ("no better than the nominal" in first) == useless
    assert "noisy measurement" in second


def test_verdict_without_held_out_poses(content: dict[str, Any]) -> None:
    crossed = {"train": _accuracy(9.0, 0.1), "cross_validation": _accuracy(4.0, 2.0) | {"folds": 5}}
    assert "5-fold cross-validation" in verdict(content | {"accuracy": crossed})[0]
    alone = verdict(content | {"accuracy": {"train": _accuracy(9.0, 0.1)}})
    assert "30 training poses" in alone[0]
    assert any("No pose was held out" in sentence for sentence in alone)


def test_verdict_keeps_truth_and_measurement_apart(content: dict[str, Any]) -> None:
    sentences = verdict(content)
    truth = next(s for s in sentences if "truth" in s)
    assert number(content["accuracy"]["truth"]["after"]["position_mm"]["rms"]) in truth
    assert "truth" not in sentences[0]


# ------------------------------------------------------------------------------------- other and several instruments


@pytest.fixture(scope="module")
def wire(configs: Path) -> dict[str, Any]:
    return content_of(*wired(configs))


@pytest.fixture(scope="module")
def both(configs: Path) -> dict[str, Any]:
    return content_of(*wired(configs, tracked=True))


def test_a_wire_is_judged_by_what_it_reads(wire: dict[str, Any]) -> None:
    text = identification_text(wire)
    after = wire["accuracy"]["test"]["after"]["distance_mm"]
    first, second, *_ = text["verdict"]
    assert first.startswith("The robot's error along the distance fell from ")
    assert first.endswith(f"to {number(after['rms'])} mm rms on 12 held-out poses.")
    assert f"95 % of these errors are below {number(after['p95'])} mm" in second
    assert any("lets expect a position error of" in sentence for sentence in text["verdict"])
    assert text["accuracy"]["head"] == ["error along the distance / mm"]
    assert text["accuracy"]["note"].startswith("Sizes of errors over observations")
    assert "with places, points and instruments' own numbers fitted" in text["accuracy"]["note"]
    assert "Distance measurements, 40 training" in text["subtitle"]
    sigma = number(wire["identification"]["noise"]["distance"]["sigma"])
    assert (
        dict(text["facts"])["noise"] == f"standard deviation {sigma} mm of distance (estimated from the training data)"
    )
    assert text["instruments"] is None


def test_two_instruments_are_told_apart(both: dict[str, Any], tmp_path: Path) -> None:
    text = identification_text(both)
    assert "Measurements of wire (distances) and tracker (positions), 40 training" in text["subtitle"]
    assert text["verdict"][0].startswith("The robot's tool error fell from ")
    assert text["verdict"][0].endswith(" on 12 held-out observations.")
    assert "those of the instruments that read whole points" in text["accuracy"]["note"]
    noise = both["identification"]["noise"]
    for group, name, reads in zip(
        text["instruments"]["groups"], ("wire", "tracker"), ("distances", "positions"), strict=True
    ):
        facts = both["instruments"][name]
        rms = [
            " → ".join(number(facts["accuracy"][part][state]["rms"]) for state in ("before", "after")) + " mm"
            for part in ("train", "test")
        ]
        sigma = noise[f"{name} {facts['quantities'][0]['noise']}"]["sigma"]
        assert group == {
            "reads": f"{reads} of smr P on flange",
            "on": "world",
            "noise": f"{number(sigma)}\u00a0mm (estimated)",
            "rows": [[name, "40", rms[0], "12", rms[1]]],
        }
    words = dict(text["facts"])["noise"]
    assert f"{number(noise['tracker position']['sigma'])} mm per axis of tracker position (estimated" in words
    assert f"{number(noise['wire distance']['sigma'])} mm of wire distance (estimated" in words
    write_report(both, (), tmp_path / "report.pdf")
    assert "distances of smr P on flange" in _text(tmp_path / "report.pdf")


def test_places_and_points_say_where_they_are(both: dict[str, Any]) -> None:
    frames = {row["label"]: row["estimated"] for row in identification_text(both)["frames"]}
    assert frames == {
        "base in world": "estimated",
        "tool in flange": "",
        "wire on world": "x, y, z estimated",
        "point smr_P in flange": "",
    }
    assert any("frames and points are increments" in note for note in identification_text(both)["parameters"]["notes"])


def test_of_instruments_that_give_no_point_the_first_one_judges(both: dict[str, Any]) -> None:
    case = copy.deepcopy(both)
    case["measurement"] |= {"of_tool": False, "error": "height", "quantity": "height_mm", "judged_by": ["wire"]}
    for states in case["accuracy"].values():
        for quantities in states.values():
            quantities["height_mm"] = quantities.pop("position_mm")
    assert verdict(case)[0].startswith("The robot's height, as wire reads it, fell from ")
    assert "those of wire" in identification_text(case)["accuracy"]["note"]


def test_noise_of_older_results_is_named_by_its_quantity(content: dict[str, Any]) -> None:
    older = {name: value for name, value in content["identification"].items() if name != "noise"}
    texts = [
        dict(identification_text(content | {"identification": found})["facts"])["noise"]
        for found in (content["identification"], older)
    ]
    assert texts[0] == texts[1]
    assert "mm per axis of position (estimated" in texts[0]
    assert "deg per axis of orientation (estimated" in texts[0]
