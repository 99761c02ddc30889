"""The step function of a query put into the loop of its search: one function in place of two.

A step of a puzzle takes half a microsecond, of two water jugs a sixth. To hand it from one function to the other costs
0.1 us, and 0.2 us for each state. So the `for ... in expand(...)` of a textbook loop (runtime/search) is replaced by
the statements of the step function, and each `yield` of these by what the loop does with a step:

    for row, key, goal, goes_on, after, _, _, last in expand(state, closed):     for this in turns:
        if unique:                                                                   ...
            closed.add(key)                                               =>         closed.add(frozen)
        ...                                                                          ...

The text of the loop stays the only one; what it must keep to is in runtime/search/step_contract.py. What is known of
the query is folded: `unique`, `goal` where there is no WHERE, `goes_on`.
"""

from __future__ import annotations

import ast
import inspect
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

from ss2sql.runtime.python.located_code import (
    AstBuilder,
    copy_tree,
    list_names_code_reads,
    list_names_code_sets,
    parse_code,
)


def inline_step_function(
    loop: Callable[..., Any],
    expand: ast.FunctionDef,
    states: list[str],
    known: Mapping[str, Any],
    name: str,
    begin: Sequence[ast.stmt],
    end: list[ast.stmt],
    build: AstBuilder,
) -> ast.FunctionDef:
    """The function `name`, which takes what the loop takes, with `expand` put in.

    A state is the values of `states`. `known` is what the query says of `problem`: {"repeats": "unique", ...}. `begin`
    and `end` stand around it all.
    """
    (text,) = parse_code(inspect.getsource(loop))
    assert isinstance(text, ast.FunctionDef)
    code = copy_tree(text.body[1:], at=build.at)  # after its docstring
    facts: dict[str, ast.expr] = {f"problem.{word}": ast.Constant(value) for word, value in known.items()}
    splice = _StepInliner(expand, states)
    code = splice.transform_block(_ConstantFolder(facts, Counter(list_names_code_sets(code))).transform_block(code))
    whole: list[ast.stmt] = [*begin, ast.Try(code, [], [], end)]
    outer = [word for line in expand.body if isinstance(line, ast.Nonlocal) for word in line.names]
    if outer:
        whole.insert(0, ast.Nonlocal(outer))
    parameters = [ast.arg(word, None) for word in inspect.signature(loop).parameters]
    arguments = ast.arguments([], parameters, None, [], [], None, [])
    return ast.fix_missing_locations(ast.FunctionDef(name, arguments, whole, [], None, **build.at))


@cache
def has_search_loop_code(loop: Callable[..., Any]) -> bool:
    """Whether the text of the loop is at hand: a program may be shipped without the files of its packages."""
    try:
        return bool(inspect.getsource(loop))
    except OSError:
        return False


class _Transformer(ast.NodeTransformer):
    def transform_block(self, code: Sequence[ast.stmt]) -> list[ast.stmt]:
        """The statements that come of some; of one there may come several, or none."""
        found: list[ast.stmt] = []
        for statement in code:
            made = self.visit(statement)
            found += made if isinstance(made, list) else [] if made is None else [made]
        return found


class _ConstantFolder(_Transformer):
    """Puts in what words stand for and leaves out what that excludes.

    Names that are set once, to a constant, are words, too; `store_counts` says how often names are set.
    """

    def __init__(self, words: dict[str, ast.expr], store_counts: Counter[str]) -> None:
        self.words, self.store_counts = words, store_counts

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return copy_tree(self.words.get(node.id, node)) if isinstance(node.ctx, ast.Load) else node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        if isinstance(node.value, ast.Name) and (word := self.words.get(f"{node.value.id}.{node.attr}")):
            return copy_tree(word)
        return self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        self.generic_visit(node)
        match node:
            case ast.Compare(ast.Constant(value=left), [ast.Eq()], [ast.Constant(value=right)]):
                return ast.Constant(left == right)
            case ast.Compare(ast.Constant(value=left), [ast.IsNot()], [ast.Constant(None)]):
                return ast.Constant(left is not None)
        return node

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.test, ast.Constant):
            return node.body if node.test.value else node.orelse
        return node

    def visit_If(self, node: ast.If) -> Any:
        test = self.visit(node.test)
        if isinstance(test, ast.Constant):
            return self.transform_block(node.body if test.value else node.orelse)
        return ast.If(test, self.transform_block(node.body) or [ast.Pass()], self.transform_block(node.orelse))

    def visit_AnnAssign(self, node: ast.AnnAssign) -> Any:
        assert node.value is not None
        return self.visit_Assign(ast.Assign([node.target], node.value))

    def visit_Assign(self, node: ast.Assign) -> Any:
        if len(node.targets) > 1:
            return self.generic_visit(node)
        (targets,), value = node.targets, self.visit(node.value)
        pairs = [(targets, value)]
        if isinstance(targets, ast.Tuple) and isinstance(value, ast.Tuple):
            pairs = list(zip(targets.elts, value.elts, strict=True))
        made: list[ast.stmt] = []
        for target, one in pairs:
            if isinstance(target, ast.Name) and self.store_counts[target.id] == 1 and isinstance(one, ast.Constant):
                self.words[target.id] = one
            else:
                made.append(ast.Assign([self.visit(target)], one))
        return made


class _StepInliner(_Transformer):
    """Puts the step function in. A state travels as the values of its variables.

    Where a search comes back to a state (`steps` of depth_first.py), the rest of its turns and all that was computed
    once for it travel with it.
    """

    def __init__(self, expand: ast.FunctionDef, states: list[str]) -> None:
        self.states = states
        self.parameters = [argument.arg for argument in expand.args.args]
        self.code = [line for line in expand.body if not isinstance(line, ast.Nonlocal)]
        *before, loop = self.code
        read, own = list_names_code_reads([loop]), {"turns", "block", "expanded", *states}
        self.state_code = [n for n in dict.fromkeys(list_names_code_sets(before)) if n in read and n not in own]

    def visit_Assign(self, node: ast.Assign) -> ast.AST:
        match node:
            case ast.Assign([ast.Name(id="steps")], ast.Call(ast.Name(id="iter"), [ast.Call(_, [state, *_])])):
                # `steps = iter(expand(state, closed))`: no turns yet
                nothing = [ast.Constant(None) for _ in self.state_code]
                begin = ast.Tuple([ast.Constant(None), *self._expand_part(state), *nothing], ast.Load())
                return ast.Assign([ast.Tuple(self._expand_part(ast.Name("steps", ast.Store())), ast.Store())], begin)
        return self.generic_visit(node)

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return ast.Tuple(self._expand_part(node), node.ctx) if node.id == "state" else node

    def visit_Tuple(self, node: ast.Tuple) -> ast.AST:
        return ast.Tuple([one for part in node.elts for one in self._expand_part(part)], node.ctx)

    def _expand_part(self, part: ast.expr) -> list[ast.expr]:
        """A part of a tuple, or the several that stand for it."""
        match part:
            case ast.Starred(ast.Name(id="state") | _NextState() as whole):  # a node of MEMORIZE
                return self._expand_part(whole)
            case ast.Name(id="state" | "steps" as word, ctx=context):
                names = self.states if word == "state" else ["turns", *self.states, *self.state_code]
                return [ast.Name(name, context) for name in names]
            case _NextState():
                return part.parts or [ast.Constant(None) for _ in self.states]
        return [self.visit(part)]

    def visit_For(self, node: ast.For) -> Any:
        match node.iter:
            case ast.Call(ast.Name(id="expand"), [_, *arguments]):
                pairs = zip(self.parameters[1:], arguments, strict=True)
                other = {name: one for name, one in pairs if not (isinstance(one, ast.Name) and one.id == name)}
                return self._inline_step_loop(node, other, resumed=False)
            case ast.Name(id="steps"):
                return self._inline_step_loop(node, {}, resumed=True)
        return self.generic_visit(node)

    def _inline_step_loop(self, node: ast.For, words: dict[str, ast.expr], resumed: bool) -> list[ast.stmt]:
        """The code of the function for the loop over its steps."""
        assert isinstance(node.target, ast.Tuple)
        names = [target.id if isinstance(target, ast.Name) else "_" for target in node.target.elts]
        *before, turns = (
            _ConstantFolder(words, Counter()).transform_block(copy_tree(self.code)) if words else copy_tree(self.code)
        )
        steps = self._replace_yields([turns], names, node.body)
        if node.orelse:
            loop = steps[-1]
            assert isinstance(loop, ast.For)
            loop.orelse = self.transform_block(node.orelse)
        if resumed:  # the turns are there already where the search comes back
            before = [ast.If(ast.Compare(ast.Name("turns", ast.Load()), [ast.Is()], [ast.Constant(None)]), before, [])]
        return [*before, *steps]

    def _replace_yields(self, code: list[ast.stmt], names: list[str], body: list[ast.stmt]) -> list[ast.stmt]:
        """The statements with what the loop does with a step in place of each `yield`."""
        found: list[ast.stmt] = []
        for line in code:
            match line:
                case ast.Expr(ast.Yield(ast.Tuple(elts=values))):
                    step = dict(zip(names, values, strict=True))
                    step.pop("_", None)
                    step["after"] = _NextState(step["after"])
                    found += self.transform_block(_ConstantFolder(step, Counter()).transform_block(copy_tree(body)))
                    continue
                case ast.For() | ast.If() | ast.While() | ast.With() | ast.Try():
                    for part in ("body", "orelse"):
                        setattr(line, part, self._replace_yields(getattr(line, part, []), names, body))
            found.append(line)
        return found


class _NextState(ast.expr):
    """The state after a step, whose values are put where it stands in a tuple; none where the step stops."""

    _fields = ("parts",)  # which a copy has, too

    def __init__(self, state: ast.expr | None = None) -> None:
        self.parts = state.elts if isinstance(state, ast.Tuple) else []
