"""Writes the loop of a search: the text of its order with the clauses of the query put in.

An order is a text in Python (searches/) that reads like the loop that it becomes. Some words in it stand for parts of
the query:

- `for element in elements:` is the loops over the sources; `turns = iter(elements)` with `for element in turns:` is one
  loop that can be left and entered again. Every turn is counted, and looks at the clock now and then.
- `ROW`, `JUDGE`, `WEIGH`, `NEXT` are the clauses of a step, see StepCode. They leave `row`, `key`, `weight`,
  `estimate`, `goal` and `state`, the state after the step. A step that JUDGE drops goes no further. What follows JUDGE
  is written twice where a step that stops can be a goal; `goes_on` says whether it does not stop.
- `here` is the state whose steps are walked, `saved` the same with all that is computed once for it, `came` where
  MEMORIZE gives it. `last` is what `found(path, last)` evaluates GROUP BY and ORDER BY of, `place` what `Trail` needs.
- `unique`, `guided` and their like are known beforehand. What they exclude is not written at all. A part of a tuple
  that is known does not travel, nor does a state that is the row of the way beside it.
"""

from __future__ import annotations

import ast
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import cache
from heapq import heappop, heappush
from typing import Any

from ss2sql.runtime.native.by_level import at_level_of
from ss2sql.runtime.native.pace import SHORT, Parts, counts_of, steps_pace_of
from ss2sql.runtime.native.searches.best_first import TAKEN
from ss2sql.runtime.native.step_code import StepCode
from ss2sql.runtime.ways import Trail, depth_of, path_to

# The first `yield` is where START WITH and the sources that are read once have been evaluated.
FRAME = """
generated = expanded = pruned = 0  # what the run has not been told yet
due = 1
turns = iter(())
yield
try:
    LOOP
finally:
    if together:
        generated -= turns.__length_hint__()  # steps are counted before their turn
    hand_on(generated, expanded, pruned)
"""

# To count steps together takes a tenth off the time of a search on a grid.
GROWTH_FRAME = """
generated = expanded = pruned = 0
due = 1
turns = iter(())
rows, goals, edges = graph.rows, graph.goals, graph.edges
targets, weights, lasts = graph.targets, graph.weights, graph.lasts
try:
    LOOP
finally:
    if together:
        generated -= turns.__length_hint__()
    hand_on(generated, expanded, pruned)
return following
"""

TURNS = f"""
turns = iter(block) if len(block) <= {SHORT} else Parts(block, run)
"""

COUNTED = """
if generated >= due:
    due = meter(generated, expanded, pruned, reached)
    generated = expanded = pruned = 0
generated += len(block) if together else 1
"""

PLACE = "(way, row, key, 1 if way is None else way[3] + 1)"

HELPERS: tuple[Callable[..., Any], ...] = (deque, depth_of, heappop, heappush, path_to, Parts, Trail)

# What words stand for: expressions, lists of names, or values that are known beforehand.
Words = Mapping[str, Any]


class LoopCode:
    """The loop of one search. `here` names the variables of its state, `keys` what evaluates GROUP BY and ORDER BY."""

    def __init__(self, step: StepCode, here: Sequence[str], keys: str | None) -> None:
        self.step = step
        self.pen = step.pen
        self.here = list(here)
        self.keys = keys
        self._order: Sequence[ast.stmt] = ()
        self._saved: list[ast.Tuple] = []
        self._before: tuple[list[ast.stmt], ast.stmt] | None = None
        self._left = False
        self.outside = self._known()
        self.inside = dict(self.outside)
        for helper in HELPERS:
            step.unit.helper(helper)
        step.unit.namespace["TAKEN"] = TAKEN

    def _known(self) -> dict[str, Any]:
        """The words that are known beforehand."""
        step, search = self.step, self.step.search
        known: dict[str, Any] = {
            "compared": step.compares,
            "unique": search.repeats == "unique",
            "no_cycle": search.repeats == "no cycle",
            "guided": search.heuristic is not None,
            "weighed": search.weight is not None,
            "keyed": self.keys is not None,
            "likeliest": search.order == "probability",
            "settled": step.is_settled,
            "together": False,
            "leveled": step.unit.by_level is step.query,
        }
        if known["leveled"]:
            run, unit = self.pen.name("run"), step.unit
            at_level = unit.bind("levels", "at_level", self.pen.call(unit.helper(at_level_of), run), self.pen)
            known["at_level"] = self.pen.name(at_level)
        if step.query.where is None:
            known["goal"] = True
        if not step.may_end:
            known["goes_on"] = True
        if not step.compares:
            known["key"] = None
        if search.weight is None:
            known["weight"] = None
        if self.keys is None:
            known["last"] = None
        return known

    def written(self, order: str, frame: str = "LOOP") -> list[ast.stmt]:
        """The statements of an order's text."""
        code: list[ast.stmt] = []
        self._order = _parsed(order)
        self.outside["reached"] = self.inside["reached"] = self._reached()
        self._block(_parsed(frame), code, self.outside)
        # Only now all is known that is computed once for a state.
        assert self._before is not None
        block, mark = self._before
        own = self.step.body.blocks[0]
        at = block.index(mark)
        block[at : at + 1] = own[:-1] if self._left else own
        names = [*self.here, *(name for name in self._of_state(own) if name not in self.step.body.shared)]
        for saved in self._saved:
            saved.elts += [ast.Name(name, saved.ctx, **self.pen.at) for name in names]
        return code

    def _of_state(self, own: Sequence[ast.stmt]) -> list[str]:
        """The names of what is computed once for a state, before its loop or where this finds its elements."""
        loop = own[-1]
        if not isinstance(loop, ast.For):
            return assigned(own[:-1])
        read = {node.id for part in loop.body for node in ast.walk(part) if isinstance(node, ast.Name)}
        return [*assigned(own[:-1]), *(name for name in assigned([loop.iter]) if name in read)]

    def _reached(self) -> ast.expr | None:
        """Where the search is, which is known by one of two names; None where it goes level by level."""
        made = {node.id for part in self._order for node in ast.walk(part) if isinstance(node, ast.Name)}
        return next((self.pen.name(word) for word in ("path", "way") if word in made), None)

    # --- statements ------------------------------------------------------------------------------------

    def _block(self, statements: Sequence[ast.stmt], code: list[ast.stmt], words: Words) -> None:
        """Writes the statements to the end of `code`."""
        pen = self.pen
        for number, statement in enumerate(statements):
            match statement:
                case ast.Expr(ast.Name("LOOP")):
                    self._block(self._order, code, words)
                case ast.Expr(ast.Name("JUDGE")):
                    self._judge(statements[number + 1 :], code)
                    return
                case ast.Expr(ast.Name("ROW" | "WEIGH" | "NEXT" as clause)):
                    self._clause(clause, code)
                case ast.If():
                    self._if(statement, code, words)
                case ast.For(iter=ast.Name("elements"), body=body):
                    self._every(body, code)
                case ast.Assign([ast.Name("turns")], ast.Call(ast.Name("iter"), [ast.Name("elements")])):
                    code.append(pen.assign("turns", pen.call("iter", self._open(code, left=True).iter)))
                case ast.For(iter=ast.Name("turns"), body=body, orelse=ended):
                    turns = self._turns(code)
                    self._count(turns.body)
                    self._block(body, turns.body, self.inside)
                    self._block(ended, turns.orelse, words)
                case ast.For(target=target, iter=items, body=body):
                    every = ast.For(self._made(target, words), self._expr(items, words), [], [], **pen.at)
                    code.append(every)
                    self._block(body, every.body, words)
                case ast.While(test=test, body=body, orelse=ended):
                    again = ast.While(self._expr(test, words), [], [], **pen.at)
                    code.append(again)
                    self._block(body, again.body, words)
                    self._block(ended, again.orelse, words)
                case ast.Try(body=body, finalbody=finally_):
                    attempt = ast.Try([], [], [], [], **pen.at)
                    code.append(attempt)
                    self._block(body, attempt.body, words)
                    self._block(finally_, attempt.finalbody, words)
                case ast.Assign([ast.Name("here")], value):
                    code.append(self._arrival(self._expr(value, words)))
                case ast.Assign([ast.Tuple([*_, ast.Starred(ast.Name("here"))])]) if self.step.state_is_row:
                    code.append(self._made(statement, words))
                    code.append(pen.unpack(self.here, pen.item(pen.name("way"), 1)))
                case _:
                    code.append(self._made(statement, words))

    def _arrival(self, state: ast.expr) -> ast.stmt:
        if len(self.here) == 1 and isinstance(state, ast.Tuple):
            return self.pen.assign(self.here[0], state.elts[0])
        return self.pen.unpack(self.here, state)

    def _if(self, statement: ast.If, code: list[ast.stmt], words: Words) -> None:
        test = self._expr(statement.test, words)
        if isinstance(test, ast.Constant):
            self._block(statement.body if test.value else statement.orelse, code, words)
            return
        written = ast.If(test, [], [], **self.pen.at)
        code.append(written)
        self._block(statement.body, written.body, words)
        self._block(statement.orelse, written.orelse, words)

    def _open(self, code: list[ast.stmt], left: bool) -> ast.For:
        """Opens the loops over the sources and gives the outermost one, which stands here unless it can be `left`."""
        loop = self.step.open(left)
        mark = ast.Pass(**self.pen.at)
        code.append(mark)
        self._before, self._left = (code, mark), left
        if self.keys is not None:
            self.inside["last"] = self.step.last()
        return loop

    def _turns(self, code: list[ast.stmt]) -> ast.For:
        """The loop over elements that have a name."""
        opened = self.step.body.blocks[0][-1]
        assert isinstance(opened, ast.For)
        code.append(turns := ast.For(opened.target, self.pen.name("turns"), opened.body, [], **self.pen.at))
        return turns

    def _every(self, body: Sequence[ast.stmt], code: list[ast.stmt]) -> None:
        """A loop over all elements; where they are a list, its steps are counted together before their turn."""
        items = self._open(code, left=False).iter
        if self.step.has_list:
            self._left = self.outside["together"] = self.inside["together"] = True
            if "choose" in self.step.body.parameters:  # which elements, memorize/both_ends.py knows
                nobody = self.pen.compare(self.pen.name("choose"), ast.Is(), self.pen.constant(None))
                items = self.pen.either(nobody, items, self.pen.call("choose", items, self.pen.name("came")))
            code.append(self.pen.assign("block", items))
            self._count(code)
            self._block(_parsed(TURNS), code, self.inside)
            self._block(body, self._turns(code).body, self.inside)
        else:
            inside = self.step.inner.blocks[-1]
            self._count(inside)
            self._block(body, inside, self.inside)

    def _count(self, code: list[ast.stmt]) -> None:
        """Counts steps."""
        unit, run = self.step.unit, self.pen.name("run")
        for word, maker in (("meter", steps_pace_of), ("hand_on", counts_of)):
            bound = unit.bind(f"{word} of steps", word, self.pen.call(unit.helper(maker), run), self.pen)
            self.outside[word] = self.inside[word] = self.pen.name(bound)
        self._block(_parsed(COUNTED), code, self.inside)

    # --- one step --------------------------------------------------------------------------------------

    def _clause(self, clause: str, code: list[ast.stmt]) -> None:
        """Writes a clause of the step; one that stands in a block of its own may be skipped."""
        step, block = self.step, self.step.inner.blocks[-1]
        write = {"ROW": step.row, "JUDGE": step.judge, "WEIGH": step.weigh, "NEXT": step.go_on}[clause]
        mark = ast.Pass(**self.pen.at)
        block.append(mark)
        with nullcontext() if code is block else step.inner.unsure():
            write()
        at = block.index(mark)  # what is computed once for each turn has been put before
        written = block[at + 1 :]
        del block[at:]
        code.extend(written)
        self.inside.update(step.words, state_is_row=step.state_is_row)

    def _judge(self, rest: Sequence[ast.stmt], code: list[ast.stmt]) -> None:
        """Writes the clauses that may drop a step, and what follows them."""
        self._clause("JUDGE", code)
        ended = ast.If(self.pen.name("stop"), [], [], **self.pen.at)
        if self.step.may_end:
            code.append(ended)
            self.inside["goes_on"] = True
        self._block(rest, code, self.inside)
        if self.step.may_end:
            self._block(rest, ended.body, {**self.inside, "goal": True, "goes_on": False, "state": None})
            ended.body.append(self.pen.next_turn())

    # --- expressions -----------------------------------------------------------------------------------

    def _expr(self, node: ast.expr, words: Words) -> ast.expr:
        made = self._made(node, words)
        assert isinstance(made, ast.expr)
        return made

    def _made(self, node: Any, words: Words) -> Any:
        """A copy of a piece of text, with what its words stand for."""
        pen = self.pen
        match node:
            case ast.Name(id=word, ctx=ast.Load()) if word in words:
                return self._meant(words[word])
            case ast.Name(id="place"):
                return self._made(_PLACE, words)
            case ast.Call(func=ast.Name("found"), args=[path, last]):
                return self._found(path, last, words)
            case ast.Yield(value=ast.Tuple(parts)):
                return pen.give(pen.pack(*(self._made(part, words) for part in parts)))
            case ast.Tuple():
                return self._tuple(node, words)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                truth = self._made(operand, words)
                return pen.constant(not truth.value) if isinstance(truth, ast.Constant) else pen.negation(truth)
            case ast.BoolOp(op=operator, values=parts):
                return self._both(operator, [self._made(part, words) for part in parts])
            case ast.IfExp(test=test, body=then, orelse=otherwise):
                known = self._made(test, words)
                if isinstance(known, ast.Constant):
                    return self._made(then if known.value else otherwise, words)
                return pen.either(known, self._made(then, words), self._made(otherwise, words))
            case ast.AST():
                fields = {name: self._made(value, words) for name, value in ast.iter_fields(node)}
                return type(node)(**fields, **(pen.at if "lineno" in node._attributes else {}))
            case list():
                return [self._made(part, words) for part in node]
            case _:
                return node

    def _meant(self, known: Any) -> ast.expr:
        if isinstance(known, list):
            return self.pen.pack(*known)
        return known if isinstance(known, ast.expr) else self.pen.constant(known)

    def _both(self, operator: ast.boolop, parts: list[ast.expr]) -> ast.expr:
        """The parts that are not known joined by the operator, or what the known ones say."""
        neutral = isinstance(operator, ast.And)
        for part in parts:
            if isinstance(part, ast.Constant) and bool(part.value) is not neutral:
                return part
        unknown = [part for part in parts if not isinstance(part, ast.Constant)]
        if len(unknown) > 1:
            return self.pen.both(operator, unknown)
        return unknown[0] if unknown else self.pen.constant(neutral)

    def _tuple(self, node: ast.Tuple, words: Words) -> ast.expr:
        parts: list[ast.expr] = []
        made = ast.Tuple(parts, node.ctx, **self.pen.at)
        for part in node.elts:
            match part:
                case ast.Starred(ast.Name("saved")):
                    self._saved.append(made)
                    return made
                case ast.Starred(ast.Name("here")):
                    if not self.step.state_is_row:
                        parts += [ast.Name(name, ast.Store(), **self.pen.at) for name in self.here]
                case ast.Starred(ast.Name("state")):
                    if not self.step.state_is_row:
                        parts += words["state"] or [self.pen.constant(None)] * len(self.here)
                case ast.Name(word) if word in self.outside and not isinstance(self.outside[word], ast.expr):
                    pass
                case _:
                    parts.append(self._made(part, words))
        return parts[0] if len(parts) == 1 else made

    def _found(self, path: ast.expr, last: ast.expr, words: Words) -> ast.expr:
        """What is yielded for a result; paths that nobody sees are not made."""
        if self.step.query.last:  # the row of the last step, without the way to it
            match path:
                case ast.Call(func=ast.Name("path_to"), args=[way]):
                    path = self.pen.item(way, 1)
                case ast.Tuple(elts=[*_, row]):
                    path = row
        if self.keys is None:
            return self._expr(path, words)
        shown = self.pen.constant(None) if self.step.query.aggregated else self._expr(path, words)
        return self.pen.pack(shown, self.pen.call(self.keys, self._expr(last, words)))


def assigned(code: Sequence[ast.AST]) -> list[str]:
    """The names that statements or expressions assign, each once."""
    nodes = [node for part in code for node in ast.walk(part) if isinstance(node, ast.Name)]
    return list(dict.fromkeys(node.id for node in nodes if isinstance(node.ctx, ast.Store)))


@cache
def _parsed(text: str) -> list[ast.stmt]:
    return ast.parse(text).body


_PLACE = ast.parse(PLACE, mode="eval").body
