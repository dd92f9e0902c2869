"""Requests at random to a station with the tokens view, operate and administer: run.py URL REQUESTS

Schemathesis makes them of the station's own description, as each of the roles in turn, until there are enough. Between
two roles, what the station has is compared: a role changes only what it may.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections import Counter
from pathlib import Path

HERE = Path(__file__).resolve().parent
# What a request may change, by the least role that may change it.
STATE = {
    "operate": ["/api/v1/rooms", "/campaigns"],
    "administer": ["/scenarios"],
}
ROLES = ["view", "operate", "administer"]
# Events have no end. An address that has tried ten tokens that are wrong is refused for a time, with right ones too.
# Both routes are tested in station/tests/api/.
LEFT_OUT = ["/api/v1/updates", "/login"]
# A wrong token costs its address a pause: Schemathesis' own check of tokens would use up those that are free. What
# checks.py does instead needs none. The others of these know less than the description: it has values that are refused
# (422), by rules that it cannot say, and names that are not there.
EXCLUDED = "ignored_auth,positive_data_acceptance,negative_data_rejection,missing_required_header"


def read(url, path):
    request = urllib.request.Request(url + path, headers={"Authorization": "Bearer administer"})
    with urllib.request.urlopen(request, timeout=30) as answer:
        return json.load(answer)


def changeable(url, role):
    """What this role may not change. Who is in a room changes by itself."""
    rank = ROLES.index(role)
    paths = [path for least, paths in STATE.items() if ROLES.index(least) > rank for path in paths]
    return {path: [{**item, "tags": None} for item in read(url, path)] for path in paths}


def run(url, role, seed, examples, counts):
    before = changeable(url, role)
    with tempfile.NamedTemporaryFile("r", suffix=".txt") as file:
        environment = {
            **os.environ,
            "SCHEMATHESIS_HOOKS": "checks",
            "PYTHONPATH": str(HERE),
            "BALIZA_ROLE": role,
            "BALIZA_COUNT": file.name,
        }
        command = [
            sys.executable, "-m", "schemathesis.cli", "run", f"{url}/openapi.json",
            "--header", f"Authorization: Bearer {role}",
            *(word for path in LEFT_OUT for word in ("--exclude-path", path)), "--exclude-checks", EXCLUDED,
            "--phases", "examples,coverage,fuzzing", "--seed", str(seed), "--max-examples", str(examples),
            "--generation-with-security-parameters", "false", "--generation-database", "none",
            "--request-timeout", "30", "--continue-on-failure", "--no-color", "--warnings", "off",
        ]  # fmt: skip
        passed = subprocess.run(command, env=environment).returncode == 0
        for line in file:
            status, count = line.split()
            counts[int(status)] += int(count)
    after = changeable(url, role)
    for path in before:
        if before[path] != after[path]:
            print(f"{role} changed {path}:\n{before[path]}\n{after[path]}", file=sys.stderr)
            passed = False
    return passed


def main():
    url, least = sys.argv[1], int(sys.argv[2])
    begun, passed, seed = time.monotonic(), True, 1
    counts = {role: Counter() for role in ROLES}
    # The first round has what the description alone gives; later ones have other seeds.
    while passed and (seed == 1 or sum(map(Counter.total, counts.values())) < least):
        for role in ROLES:
            passed &= run(url, role, seed, max(least // 300, 1), counts[role])
        seed += 1
    for role, statuses in counts.items():
        print(f"{role}: {statuses.total()} requests, " + ", ".join(f"{n} × {s}" for s, n in sorted(statuses.items())))
    total = sum(map(Counter.total, counts.values()))
    print(f"{total} requests in {time.monotonic() - begun:.0f} s: {'as described' if passed else 'NOT as described'}")
    sys.exit(not passed)


if __name__ == "__main__":
    main()
