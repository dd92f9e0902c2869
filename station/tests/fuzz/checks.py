"""What is checked of each answer besides what Schemathesis checks, and how fast requests come.

Schemathesis loads this file (SCHEMATHESIS_HOOKS). BALIZA_ROLE is the role of the token that it sends, BALIZA_COUNT a
file to which the number of requests is added at the end.
"""

import atexit
import os
import threading
import time
from collections import Counter

import requests
import schemathesis

ROLES = ["view", "operate", "administer"]
ROLE = os.environ["BALIZA_ROLE"]
# The station allows an address 50 changes a second.
PAUSE_S = 1 / 45
# Requests of an operation that are made once more without a token.
WITHOUT_TOKEN = 3

counts = Counter()
without = Counter()
lock = threading.Lock()
next_change = [0.0]


def need(case):
    """The least role of an operation; None: it asks for none."""
    security = case.operation.definition.raw.get("security", [])
    roles = [roles for entry in security for roles in entry.values()]
    return roles[0][0] if roles and {} not in security else None


@schemathesis.hook
def before_call(context, case, kwargs):
    if case.method in ("GET", "HEAD", "OPTIONS"):
        return
    with lock:
        now = time.monotonic()
        at = max(next_change[0], now)
        next_change[0] = at + PAUSE_S
    time.sleep(at - now)


@schemathesis.check
def roles_are_kept(ctx, response, case):
    """A role may do what its operations say, and nothing else; without a token nothing that asks for one."""
    status = response.status_code
    counts[status] += 1
    assert status != 429, "too many requests: the pauses between them are too short"
    if case.method.upper() != case.operation.method.upper() or status in (404, 405, 408, 421):
        return
    request = response.request
    if request.headers.get("Authorization") != f"Bearer {ROLE}":
        return
    least = need(case)
    may = least is None or ROLES.index(ROLE) >= ROLES.index(least)
    assert status != 401, "the token is refused"
    assert (status == 403) != may, f"{ROLE} got {status} where {least} is asked for"
    if least is None or without[case.operation.label] >= WITHOUT_TOKEN:
        return
    without[case.operation.label] += 1
    headers = {name: value for name, value in request.headers.items() if name.lower() not in ("authorization", "cookie")}
    again = requests.request(request.method, request.url, headers=headers, data=request.body, timeout=30)
    counts[again.status_code] += 1
    assert again.status_code == 401, f"without a token: {again.status_code}"


@atexit.register
def add_counts():
    with open(os.environ["BALIZA_COUNT"], "a") as file:
        for status, count in sorted(counts.items()):
            print(status, count, file=file)
