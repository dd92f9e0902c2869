"""The example's recording, and the program whose output the package must equal."""

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def room() -> Path:
    """A walk through a room: anchors, ranges, truth."""
    return ROOT / "examples" / "room"


@pytest.fixture(scope="session")
def program():
    """Runs `baliza` with arguments, and returns its standard output. BALIZA_BUILT says that `cargo test` has built it."""
    target = ROOT / os.environ.get("CARGO_TARGET_DIR", "target")
    if "BALIZA_BUILT" not in os.environ:
        subprocess.run(["cargo", "build", "--quiet", "-p", "host-tools", "--bin", "baliza", "--all-features"], cwd=ROOT, check=True)

    def run(*arguments) -> str:
        command = [target / "debug" / "baliza", *map(str, arguments)]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    return run
