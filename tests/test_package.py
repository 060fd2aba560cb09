"""What is installed, under which names."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import inspect
import subprocess
import sys
from importlib.resources import files

import algdiff

DISTRIBUTION = "algdiff-rs"  # never "algdiff": that is another project


def test_the_version_is_that_of_our_distribution() -> None:
    assert algdiff.__version__ == importlib.metadata.version(DISTRIBUTION)


def test_numpy_is_the_only_requirement() -> None:
    required = importlib.metadata.requires(DISTRIBUTION) or []
    assert [entry for entry in required if "extra ==" not in entry] == ["numpy>=1.23"]


def test_importing_takes_numpy_alone() -> None:
    code = "import sys, algdiff; print([m for m in ('scipy', 'matplotlib', 'argparse') if m in sys.modules])"
    result = subprocess.run([sys.executable, "-I", "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout == "[]\n"


def test_types_and_licences_are_shipped() -> None:
    package = files("algdiff")
    assert (package / "py.typed").is_file()
    assert (package / "_core.pyi").is_file()
    assert "Copyright (c) 2022" in (package / "data" / "LICENSE-pendulum_encoder").read_text(encoding="utf-8")


def test_every_public_name_is_documented_with_an_example() -> None:
    for name in algdiff.__all__:
        thing = getattr(algdiff, name)
        if inspect.isfunction(thing) or (inspect.isclass(thing) and not issubclass(thing, Exception)):
            documentation = inspect.getdoc(thing) or ""
            is_result = inspect.isclass(thing) and (issubclass(thing, tuple) or dataclasses.is_dataclass(thing))
            for section in [*(["Attributes"] if is_result else ["Parameters", "Raises"]), "Examples", ">>>"]:
                assert section in documentation, f"{name}: {section}"
