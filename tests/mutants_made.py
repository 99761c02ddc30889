"""Mutants of a module: small changes of what its functions say, each described by words that outlive other edits."""

from __future__ import annotations

import ast
import copy
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice, zip_longest
from pathlib import Path
from types import CodeType
from typing import Any, cast

COMPARED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip
COMPUTED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.FloorDiv, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult, ast.Pow: ast.Mult, ast.BitOr: ast.BitAnd, ast.BitAnd: ast.BitOr,
}  # fmt: skip
# What runs when a function is defined, or never.
NOT_MUTATED = ("annotation", "returns", "decorator_list", "type_params", "args", "bases")
NEVER = ("assert_never", "AssertionError", "NotImplementedError")

Function = ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda
Edit = Callable[[], None]


@dataclass(frozen=True)
class Mutant:
    """One change: the file below the package, the outermost function that it is in, what it does, and its lines now."""

    file: str
    function: str
    change: str
    line: int
    begin: int
    number: int

    @property
    def name(self) -> str:
        """The words by which it is known: a file, a function and a change, never a line."""
        return f"{self.file} {self.function}: {self.change}"


@dataclass(frozen=True)
class Site:
    """Where a function stands in a module: the key by which its code is found again."""

    function: str
    line: int


def mutants(path: Path, file: str) -> list[Mutant]:
    """All mutants of a file in the order of the text, without those whose function cannot be told from another."""
    text = path.read_text(encoding="utf-8")
    known = codes(compile(text, str(path), "exec", dont_inherit=True))
    made = []
    seen: Counter[tuple[str, str]] = Counter()
    for number, (site, line, change, _) in enumerate(changes(ast.parse(text))):
        if site in known:
            seen[site.function, change] += 1
            count = seen[site.function, change]
            words = change if count == 1 else f"{change} ({count})"
            made.append(Mutant(file, site.function, words, line, site.line, number))
    return made


def mutated(path: Path, mutant: Mutant) -> tuple[Site, CodeType]:
    """The function that holds a mutant, and its new code."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    site, _, _, edit = next(islice(changes(tree), mutant.number, None))
    edit()
    module = compile(ast.fix_missing_locations(tree), str(path), "exec", dont_inherit=True)
    return site, codes(module)[site]


def codes(module: CodeType) -> dict[Site, CodeType]:
    """The functions of a module and of its classes; those that share name and line cannot be told apart and miss."""
    found: dict[Site, CodeType] = {}
    twice = set()
    pending = [module]
    while pending:
        for code in pending.pop().co_consts:
            if not isinstance(code, CodeType):
                continue
            if not code.co_flags & 0x2:  # a class: only functions have new locals
                pending.append(code)
                continue
            site = Site(code.co_qualname, code.co_firstlineno)
            twice |= {site} & found.keys()
            found[site] = code
    return {site: code for site, code in found.items() if site not in twice}


# --- walking -------------------------------------------------------------------------------------------


def changes(tree: ast.Module) -> Iterator[tuple[Site, int, str, Edit]]:
    """Every change, with the function and the line that it is in, and what makes it in the tree."""
    for prefix, function in functions(tree, ""):
        name = "<lambda>" if isinstance(function, ast.Lambda) else function.name
        decorators = [] if isinstance(function, ast.Lambda) else function.decorator_list
        site = Site(prefix + name, min([function.lineno, *(one.lineno for one in decorators)]))
        body = [function.body] if isinstance(function, ast.Lambda) else function.body
        for node in nodes(body):
            for line, change, edit in of_node(node):
                yield site, line, change, edit


def functions(node: ast.AST, prefix: str) -> Iterator[tuple[str, Function]]:
    """The outermost functions of a module and of its classes."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, Function):
            yield prefix, child
        elif isinstance(child, ast.ClassDef):
            yield from functions(child, f"{prefix}{child.name}.")
        else:
            yield from functions(child, prefix)


def nodes(body: list[ast.stmt] | list[ast.expr]) -> Iterator[ast.expr | ast.stmt]:
    """What may be changed below a body, without annotations, docstrings and what asserts."""
    for node in body:
        yield from below(node)


def below(node: ast.AST) -> Iterator[ast.expr | ast.stmt]:
    match node:
        case ast.Assert() | ast.Expr(value=ast.Constant()) | ast.keyword(arg="strict"):  # of `zip`, which asserts
            return
        case ast.Raise() | ast.Expr() if any(word in ast.unparse(node) for word in NEVER):
            return
        case ast.expr() | ast.stmt():
            yield node
    for field, value in ast.iter_fields(node):
        skipped = field in NOT_MUTATED and not isinstance(node, ast.Call)
        for one in [] if skipped else value if isinstance(value, list) else [value]:
            if isinstance(one, ast.AST):
                yield from below(one)


# --- changes -------------------------------------------------------------------------------------------


def of_node(node: ast.expr | ast.stmt) -> Iterator[tuple[int, str, Edit]]:
    """What may be changed of one node: the line that tests have to reach, the change in words, and what makes it."""
    before = short(node)
    for new in expressions(node) if isinstance(node, ast.expr) else statements(node):
        if isinstance(node, ast.Match):
            yield *arms(node, cast(ast.Match, new)), partial(replace, node, new)
        elif short(new) != before:
            yield node.lineno, f"{before} -> {short(new)}", partial(replace, node, new)


def short(node: ast.AST) -> str:
    """A node on one line; of what holds statements only the head."""
    return "nothing" if isinstance(node, ast.Pass) else ast.unparse(node).split("\n")[0]


def arms(node: ast.Match, new: ast.Match) -> tuple[int, str]:
    """How a match has changed: the first case that is another now. Without it, what comes to its body is amiss."""
    before, after = ([short(case) for case in one.cases] for one in (node, new))
    index = next(number for number, pair in enumerate(zip_longest(before, after)) if pair[0] != pair[1])
    changed, case = before[index], node.cases[index]
    if len(after) < len(before):
        return case.body[0].lineno, f"{changed} -> nothing"
    return case.pattern.lineno, f"{changed} -> {changed.partition(' if ')[0]}:"


def replace(node: ast.AST, new: ast.AST) -> None:
    """Makes a node another one where it stands: whoever holds it holds the new one."""
    ast.copy_location(new, node)
    node.__class__ = new.__class__
    node.__dict__.clear()
    node.__dict__.update(new.__dict__)


def expressions(node: ast.expr) -> Iterator[ast.AST]:
    """What can be made of an expression."""
    match node:
        case ast.Compare(ops=ops):
            for index, op in enumerate(ops):
                new = copied(node)
                new.ops[index] = COMPARED[type(op)]()
                yield new
        case ast.BoolOp(op=op, values=values):
            new = copied(node)
            new.op = ast.Or() if isinstance(op, ast.And) else ast.And()
            yield new
            for index in range(len(values)):
                new = copied(node)
                del new.values[index]
                yield new if len(new.values) > 1 else new.values[0]
        case ast.UnaryOp(op=ast.Not()):
            yield copied(node).operand
        case ast.BinOp(op=op) if type(op) in COMPUTED:
            new = copied(node)
            new.op = COMPUTED[type(op)]()
            yield new
        case ast.IfExp():
            yield copied(node).body
            yield copied(node).orelse
        case ast.Constant(value=value) if other(value) is not None:
            yield ast.Constant(other(value))
        case ast.Call():
            yield from calls(node)
        case ast.ListComp() | ast.SetComp() | ast.GeneratorExp() | ast.DictComp():
            for index, generator in enumerate(node.generators):
                for place in range(len(generator.ifs)):
                    new = copied(node)
                    del new.generators[index].ifs[place]
                    yield new


def calls(node: ast.Call) -> Iterator[ast.AST]:
    """Calls with a named argument less, or with two in each other's place; without a positional one most only break."""
    for index, one in enumerate(node.keywords):
        if one.arg not in (None, "strict"):
            new = copied(node)
            del new.keywords[index]
            yield new
    if len(node.args) > 1 and not any(isinstance(one, ast.Starred) for one in node.args[:2]):
        new = copied(node)
        new.args[:2] = new.args[1::-1]
        yield new


def statements(node: ast.stmt) -> Iterator[ast.AST]:
    """What can be made of a statement."""
    match node:
        case ast.If(test=test) | ast.While(test=test) if not isinstance(test, ast.UnaryOp):
            new = copied(node)
            new.test = ast.UnaryOp(ast.Not(), new.test)
            yield new
        case ast.Return(value=ast.expr() as value) if ast.unparse(value) not in ("None", "False"):
            yield ast.Return(ast.Constant(None))
        case ast.Expr() | ast.Assign() | ast.AugAssign() | ast.Raise() | ast.Delete() | ast.AnnAssign(value=ast.expr()):
            yield ast.Pass()
        case ast.Continue():
            yield ast.Break()
        case ast.Break():
            yield ast.Continue()
        case ast.Match(cases=cases):
            for index, case in enumerate(cases):
                if case.guard is not None:
                    new = copied(node)
                    new.cases[index].guard = None
                    yield new
                if len(cases) > 1:
                    new = copied(node)
                    del new.cases[index]
                    yield new


def copied(node: ast.AST) -> Any:
    """A copy of a node, to be changed."""
    return copy.deepcopy(node)


def other(value: object) -> bool | int | float | str | None:
    """Another constant of the same type; None for those that have none."""
    match value:
        case bool():
            return not value
        case int() | float():
            return value + 1
        case str():
            return f"{value[: len(value) // 2]}XX{value[len(value) // 2 :]}"  # a test of a part sees it
        case _:
            return None
