"""The exercises of docs/guides/course.md: both engines agree, and a loop in Python finds the same."""

import re
from collections import deque
from itertools import pairwise, permutations

import pytest
from pages import BLOCK, ROOT, Player

PAGE = ROOT / "docs" / "guides" / "course.md"


@pytest.fixture(scope="module")
def course(tmp_path_factory):
    """The namespace of the page after its Python, and its scripts by the number of the exercise."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("course"))
        player, scripts, text = Player(), {}, PAGE.read_text("utf-8")
        for block in BLOCK.finditer(text):
            if block["kind"] == "python":
                player.python(block["body"], text.count("\n", 0, block.start("body")))
            elif block["kind"] == "selectscript":
                scripts[int(re.findall(r"^## (\d+)", text[: block.start()], re.MULTILINE)[-1])] = block["body"]
        yield player.names, scripts
        player.close()


def shortest(start, steps, is_goal):
    """The number of steps to the nearest goal."""
    queue, seen = deque([(start, 0)]), {repr(start)}
    while queue:
        state, length = queue.popleft()
        if is_goal(state):
            return length
        for after in steps(state):
            if repr(after) not in seen:
                seen.add(repr(after))
                queue.append((after, length + 1))
    return None


def pour(state):
    a, b = state
    yield from ((4, b), (a, 3), (0, b), (a, 0), (max(a + b - 3, 0), min(a + b, 3)), (min(a + b, 4), max(a + b - 4, 0)))


def row(state):
    (m, c), sign = state
    for more in ((1, 0), (2, 0), (1, 1), (0, 1), (0, 2)):
        left = m + sign * more[0], c + sign * more[1]
        if all(0 <= n <= 3 for n in left) and (left[0] in (0, 3) or left[0] == left[1]):
            yield left, -sign


def expected(names, number):
    """The length of a shortest plan."""
    words, directions = names["ss"].get("words"), [(1, 0), (0, 1), (-1, 0), (0, -1)]
    free = {tuple(cell) for cell in names["ss"].get("free")}
    actions = names["ss"].get("actions")
    match number:
        case 1:
            return shortest((0, 0), pour, lambda state: state[0] == 2)
        case 2:
            return shortest(((3, 3), -1), row, lambda state: state[0] == (0, 0))
        case 5:
            near = lambda word: [w for w in words if sum(a != b for a, b in zip(w, word, strict=True)) == 1]  # noqa: E731
            return shortest("cold", near, lambda word: word == "warm")
        case 7:
            around = lambda at: [to for dx, dy in directions if (to := (at[0] + dx, at[1] + dy)) in free]  # noqa: E731
            return shortest((4, 2), around, lambda at: at == (4, 4))
        case 8:
            slide = names["slide"]
            boards = lambda board: [to for step in (-3, -1, 1, 3) if (to := slide(board, step))]  # noqa: E731
            return shortest("1_3425786", boards, lambda board: board == "12345678_")
        case 9:
            push = names["push"]
            states = lambda state: [to for dx, dy in directions if (to := push(state, dx, dy))]  # noqa: E731
            return shortest([[1, 4], [[3, 3], [2, 3]]], states, lambda state: state[1] == [[3, 2], [4, 3]])
        case 10:
            start = frozenset({"C on A", "A on table", "B on table", "clear C", "clear B"})
            after = lambda facts: [  # noqa: E731
                (facts - set(one["deletes"])) | set(one["adds"]) for one in actions if facts >= set(one["needs"])
            ]
            return shortest(start, after, lambda facts: facts >= {"A on B", "B on C"})


@pytest.mark.parametrize("number", range(1, 11))
def test_an_exercise(course, number) -> None:
    names, scripts = course
    native, result = (names["ss"].run(scripts[number], engine=engine) for engine in ("native", "auto"))
    assert native.value == result.value
    assert result.notes == ()
    match number:
        case 3:
            boards = permutations(range(8))
            safe = [b for b in boards if all(abs(b[i] - b[j]) != i - j for i in range(8) for j in range(i))]
            assert result.value == [{"count": len(safe)}]
        case 4:
            squares = [divmod(int(square), 10) for square in result.value.split()]
            assert len(set(squares)) == 24
            assert all(sorted((abs(a - c), abs(b - d))) == [1, 2] for (a, b), (c, d) in pairwise(squares))
        case 6:
            (solved,) = (one["solved"] for one in result.value)
            rows = [solved[n : n + 9] for n in range(0, 81, 9)]
            blocks = [[rows[y + j][x + i] for j in range(3) for i in range(3)] for y in (0, 3, 6) for x in (0, 3, 6)]
            assert all(sorted(unit) == list("123456789") for unit in (*rows, *zip(*rows, strict=True), *blocks))
        case 9:
            assert result.value[0]["moves"] == expected(names, number)
        case _:
            assert len(result.paths[0]) == expected(names, number)
