"""What is compiled into the package: few crates, locked, from the registry, under licences that allow it.

Counts the crates that go into a wheel of any platform: normal and build dependencies of `algdiff-py` on all targets,
with the workspace's own three. Bans, licences and sources are checked by cargo-deny against `deny.toml`. Returns 1 if
a step fails.
"""

from __future__ import annotations

import argparse
import shutil
import sys

import supply

MOST = 95  # crates in a wheel
DENY = "0.20.2"


def lock() -> str:
    """Check that the lock file is committed and says what the manifests ask for."""
    supply.run("git", "ls-files", "--error-unmatch", "Cargo.lock")
    supply.run("cargo", "tree", "--locked", "--quiet", "--depth", "0")
    return f"Cargo.lock is committed and current, {len(supply.locked())} crates with those of tests"


def count() -> str:
    """Count the crates of the package."""
    everywhere, here = len(supply.crates()), len(supply.crates(everywhere=False))
    if everywhere > MOST:
        raise supply.FailureError(f"{everywhere} crates, allowed are {MOST}")
    return f"{everywhere} in a wheel of any platform (at most {MOST}), {here} of them on this one"


def deny() -> str:
    """Run cargo-deny."""
    if shutil.which("cargo-deny") is None:
        raise supply.FailureError(f"cargo-deny is not installed: cargo install --locked cargo-deny --version {DENY}")
    supply.run("cargo", "deny", "--locked", "check", "bans", "licenses", "sources")
    return "bans, licences and sources as deny.toml wants them"


def main() -> int:
    """Run all steps."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    return supply.steps({"lock file": lock, "crates": count, "cargo deny": deny})


if __name__ == "__main__":
    sys.exit(main())
