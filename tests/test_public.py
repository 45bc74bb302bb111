"""The public names: each is there, and importing the package loads nothing heavy."""

import subprocess
import sys

import pytest

import symcal as sc


@pytest.mark.parametrize("name", sc.__all__)
def test_every_public_name_is_there_and_documented(name: str) -> None:
    assert getattr(sc, name).__doc__


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="nonsense"):
        _ = sc.nonsense


def test_import_and_help_load_no_numerical_library() -> None:
    heavy = ("casadi", "matplotlib", "pandas", "cv2")
    code = f"import sys, symcal, symcal.cli; print([m for m in {heavy} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"
