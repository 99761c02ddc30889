"""Graphs in a file outlive crashes, and several processes extend one at once."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from remembering import KNOWN, MAZE, asked, calls, fresh, output, process, scratch

SEARCH = f"""
import json, ss2sql
from maze import near

def search(goal, bound):
    with ss2sql.connect("graphs.db") as ss:
        ss.function("near", near, volatility="immutable")
        result = ss.run('''{MAZE}'''.replace("bound", str(bound)), goal=goal, first=1, limit=4000)
        return result.value, sum(result.stats.calls.values()), len(ss.graphs())
"""

# A process that only does this has no threads, so it may fork.
KILLS = (
    f"""
KNOWN = '''{KNOWN}'''
"""
    + """
import os, random, signal, sqlite3, time
# Else each child would begin with importing them.
import ss2sql.runtime.graph_cache.cached_steps, ss2sql.session.session

dice, longest, before = random.Random(1), 0.4, 0
for number in range(10):
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        os.write(writer, b"!")
        search(6, 8)
        os._exit(0)
    os.read(reader, 1)
    time.sleep(dice.uniform(0, longest))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    plain = sqlite3.connect("graphs.db")
    begun = plain.execute("SELECT 1 FROM sqlite_schema WHERE name = 'ss2sql_states'").fetchall()
    known = plain.execute(KNOWN).fetchall() if begun else []
    assert set(known) <= {(3, 3)}, known
    print(known.count((3, 3)))
    if known.count((3, 3)) == before:
        longest *= 1.5  # on a busy machine
    before = known.count((3, 3))
    plain.close()
"""
)


@pytest.mark.slow
def test_killed_ten_times_while_it_grows(tmp_path: Path) -> None:
    """Each run goes on where the one before has written last: nothing known is lost, nothing is half known."""
    out = output(process(tmp_path, SEARCH + KILLS + "print(json.dumps(search(6, 8)))", SECONDS="0.002"))
    *known, last = out.split("\n")[:-1]
    counts = [int(line) for line in known]
    value, called, graphs = json.loads(last)
    assert len(counts) == 10
    assert counts == sorted(counts)
    assert counts[-1] > 0
    assert value == fresh(goal=6, bound=8, limit=4000)
    assert called == calls(scratch(goal=6, bound=8, limit=4000)) - counts[-1]
    assert graphs == 1


def test_in_a_new_process_nothing_is_called(tmp_path: Path) -> None:
    for number in range(2):
        value, called, graphs = json.loads(output(process(tmp_path, SEARCH + "print(json.dumps(search(6, 6)))")))
        assert value == fresh(goal=6, bound=6, limit=4000)
        assert (called == 0) == (number == 1)
        assert graphs == 1


@pytest.mark.slow
def test_two_processes_at_once(tmp_path: Path) -> None:
    wanted = [(6, 7), (12, 8)]
    started = [
        process(tmp_path, SEARCH + f"print(json.dumps(search({goal}, {bound})))", SECONDS="0.001")
        for goal, bound in wanted
    ]
    answers = [json.loads(output(one)) for one in started]
    for (goal, bound), (value, _, graphs) in zip(wanted, answers, strict=True):
        assert value == fresh(goal=goal, bound=bound, limit=4000)
        assert graphs == 1
    assert sum(called for _, called, _ in answers) > 0  # one that starts late may find everything in the file
    value, called, graphs = json.loads(output(process(tmp_path, SEARCH + "print(json.dumps(search(6, 8)))")))
    assert value == fresh(goal=6, bound=8, limit=4000)
    assert called == 0
    assert set(asked(tmp_path / "graphs.db", KNOWN)) == {(3, 3)}
