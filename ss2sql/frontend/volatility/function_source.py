"""The source of a Python function: its node in the syntax tree of its file, and which names are given a value once.

The file on disk may differ from what runs. So a node counts as a function's source only when it compiles to the very
code of the function; this also distinguishes several lambdas on one line.
"""

from __future__ import annotations
import __future__

import ast
import inspect
import linecache
import os
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from types import CodeType, FunctionType
from typing import Any, TypeAlias

from ss2sql.fast_dataclasses import dataclass

FunctionNode: TypeAlias = ast.FunctionDef | ast.Lambda
Comprehension: TypeAlias = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp
FunctionPlace: TypeAlias = tuple[FunctionNode, tuple[ast.AST, ...]]  # a function, and the functions around it

_FUTURE = 0
for _feature in __future__.all_feature_names:
    _FUTURE |= getattr(__future__, _feature).compiler_flag


@dataclass(frozen=True, slots=True)
class Module:
    """A file's functions by first line and name, each with the functions around it, and its global names."""

    functions: dict[tuple[int, str], list[FunctionPlace]]
    names: Counter[str]  # how often each global name is given a value; imports do not count
    imports: tuple[ast.stmt, ...]  # a statement that imports all names that the module imports

    def is_bound_once(self, name: str) -> bool:
        """Whether the file gives this global name a value once at the most."""
        return name in self.names and self.names[name] <= 1


@dataclass(frozen=True, slots=True)
class Located:
    """A function's node, the functions around it from the outermost inwards, and its file."""

    node: FunctionNode
    around: tuple[ast.AST, ...]
    module: Module
    whole: bool  # whether the file is that of the function's module, so that it shows every assignment

    def is_closure_bound_once(self, name: str) -> bool:
        """Whether a name of an enclosing function is given its value exactly once."""
        for owner in reversed(self.around):
            times = _count_bindings_of_function(owner)
            if name in times:
                return times[name] == 1 and not any(
                    isinstance(node, ast.Nonlocal) and name in node.names for node in ast.walk(owner)
                )
        return False


def locate_function(function: FunctionType) -> Located | None:
    """The source of a function; None where there is none, or where it differs from what runs."""
    code = function.__code__
    module = read_module(code.co_filename, function.__globals__)
    if module is None:
        return None
    for node, around in module.functions.get((code.co_firstlineno, code.co_name), ()):
        if _is_source_of_code(node, code, module.imports):
            file = function.__globals__.get("__file__")
            whole = isinstance(file, str) and os.path.abspath(file) == os.path.abspath(code.co_filename)
            return Located(node, around, module, whole)
    return None


def read_module(filename: str, namespace: dict[str, Any]) -> Module | None:
    """The contents of a Python file; None where it is missing or has a syntax error."""
    linecache.checkcache(filename)
    text = "".join(linecache.getlines(filename, namespace))
    return _parse_module(text) if text else None


@lru_cache(maxsize=4)
def _parse_module(text: str) -> Module | None:
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError):
        return None
    functions: dict[tuple[int, str], list[FunctionPlace]] = defaultdict(list)
    names = _count_bindings(tree.body)
    pending: list[tuple[ast.AST, tuple[ast.AST, ...]]] = [(tree, ())]
    while pending:
        node, around = pending.pop()
        match node:
            case ast.Global(names=declared):
                names.update([*declared, *declared])
            case ast.FunctionDef():
                first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
                functions[first, node.name].append((node, around))
            case ast.Lambda():
                functions[node.lineno, "<lambda>"].append((node, around))
        if isinstance(node, ast.FunctionDef | ast.Lambda | ast.AsyncFunctionDef | Comprehension):
            around = (*around, node)
        pending.extend((child, around) for child in ast.iter_child_nodes(node))
    imported = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    aliases = [ast.alias(_name_import(alias)) for node in imported for alias in node.names if alias.name != "*"]
    imports = (ast.fix_missing_locations(ast.Import(aliases)),) if aliases else ()
    return Module(dict(functions), names, imports)


def _is_source_of_code(node: FunctionNode, code: CodeType, imports: Sequence[ast.stmt]) -> bool:
    body: list[ast.stmt] = [node if isinstance(node, ast.FunctionDef) else ast.copy_location(ast.Expr(node), node)]
    try:
        if code.co_flags & inspect.CO_NESTED:
            # The free names of the function become parameters of a function around it.
            wrapper = ast.parse(f"def _({', '.join(code.co_freevars)}): pass").body[0]
            assert isinstance(wrapper, ast.FunctionDef)
            wrapper.body = body
            body = [wrapper]
        flags = code.co_flags & _FUTURE
        # Python compiles `name.f()` differently where the module imports `name`.
        compiled = compile(ast.Module([*imports, *body], []), code.co_filename, "exec", flags, dont_inherit=True)
    except (SyntaxError, ValueError, RecursionError):
        return False
    if code.co_flags & inspect.CO_NESTED:
        compiled = next(const for const in compiled.co_consts if isinstance(const, CodeType))
    return any(isinstance(const, CodeType) and const == code for const in compiled.co_consts)


def list_parameters(arguments: ast.arguments) -> Iterator[ast.arg]:
    """The parameters of a function, starred ones included."""
    yield from (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)
    yield from (starred for starred in (arguments.vararg, arguments.kwarg) if starred is not None)


def pair_targets(target: ast.expr, value: ast.expr) -> Iterator[tuple[ast.expr, ast.expr | None]]:
    """The single targets of an assignment, each with its value, or with None for a part of a value."""
    match target, value:
        case ((ast.Tuple(elts=left) | ast.List(elts=left)), (ast.Tuple(elts=right) | ast.List(elts=right))) if len(
            left
        ) == len(right) and not any(isinstance(part, ast.Starred) for part in (*left, *right)):
            for part, part_value in zip(left, right, strict=True):
                yield from pair_targets(part, part_value)
        case ((ast.Name() | ast.Subscript() | ast.Attribute()), _):
            yield target, value
        case _:
            yield target, None


# --- names that are given a value once -----------------------------------------------------------------


def _count_bindings(nodes: Iterable[ast.AST], repeated: bool = False) -> Counter[str]:
    """How often parts of a scope give each name a value; not at all by an import, twice where that may run again."""
    found: Counter[str] = Counter()
    for node, again in _iterate_scope(nodes, repeated):
        match node:
            case ast.Import(names=aliases) | ast.ImportFrom(names=aliases):
                found.update(dict.fromkeys(map(_name_import, aliases), 0))
            case (
                ast.FunctionDef(name=str(name))
                | ast.AsyncFunctionDef(name=str(name))
                | ast.ClassDef(name=str(name))
                | ast.Name(id=str(name), ctx=ast.Store() | ast.Del())
                | ast.ExceptHandler(name=str(name))
                | ast.MatchAs(name=str(name))
                | ast.MatchStar(name=str(name))
                | ast.MatchMapping(rest=str(name))
            ):
                found[name] += 1 + again
    return found


def _iterate_scope(nodes: Iterable[ast.AST], repeated: bool) -> Iterator[tuple[ast.AST, bool]]:
    """The nodes of a scope, without the bodies of functions and classes in it, and whether each may run again."""
    for node in nodes:
        yield node, repeated
        inside: Iterable[ast.AST] = ast.iter_child_nodes(node)
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                inside = [part for part in inside if not isinstance(part, ast.stmt)]
            case ast.Lambda(args=arguments):
                inside = [arguments]
            case ast.ListComp() | ast.SetComp() | ast.DictComp() | ast.GeneratorExp():
                # The targets are local to the comprehension, but `:=` inside it binds out here.
                inside = [part for part in ast.walk(node) if isinstance(part, ast.NamedExpr)]
        loops = isinstance(node, ast.For | ast.AsyncFor | ast.While | Comprehension)
        yield from _iterate_scope(inside, repeated or loops)


def _count_bindings_of_function(owner: ast.AST) -> Counter[str]:
    """How often a function, lambda or comprehension gives each of its names a value."""
    if isinstance(owner, Comprehension):
        return _count_bindings([generator.target for generator in owner.generators], repeated=True)
    assert isinstance(owner, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
    body = [owner.body] if isinstance(owner, ast.Lambda) else owner.body
    return _count_bindings(body) + Counter(parameter.arg for parameter in list_parameters(owner.args))


def _name_import(alias: ast.alias) -> str:
    """The name that an import binds."""
    return alias.asname or alias.name.partition(".")[0]
