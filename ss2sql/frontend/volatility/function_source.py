"""The source of a Python function: its node in the syntax tree of its file, and the bindings of names.

The file on disk may differ from what runs. So a node counts as a function's source only when it compiles to the very
code of the function; this also distinguishes several lambdas on one line.
"""

from __future__ import annotations
import __future__

import ast
import inspect
import linecache
import os
from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import lru_cache
from types import CodeType, FunctionType
from typing import Any, Literal, TypeAlias

from ss2sql.fast_dataclasses import dataclass

FunctionNode: TypeAlias = ast.FunctionDef | ast.Lambda
Comprehension: TypeAlias = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp
Owner: TypeAlias = FunctionNode | ast.AsyncFunctionDef | Comprehension
BindingTable: TypeAlias = tuple[FunctionNode, tuple[Owner, ...]]
BindingKind: TypeAlias = Literal["parameter", "value", "update", "function", "import", "error", "other"]

_FUTURE = 0
for _feature in __future__.all_feature_names:
    _FUTURE |= getattr(__future__, _feature).compiler_flag

# The nodes that bind names, loop or open a scope.
_BINDING = frozenset(
    [
        *(ast.Assign, ast.AnnAssign, ast.NamedExpr, ast.AugAssign, ast.Name, ast.Import, ast.ImportFrom),
        *(ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Lambda, ast.For, ast.AsyncFor, ast.While),
        *(ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp, ast.comprehension),
        *(ast.ExceptHandler, ast.MatchAs, ast.MatchStar, ast.MatchMapping),
    ]
)


@dataclass(frozen=True, slots=True)
class Binding:
    """A place that gives a name a value.

    `node` is the value's expression for "value", the statement for "update" (`x += 1`) and "import", the definition for
    "function", and None otherwise; "other" is a loop variable, a part of a tuple, a deletion and the like.
    `looped` says that the place may run more than once while its scope lives.
    """

    how: BindingKind
    node: ast.AST | None = None
    looped: bool = False


Names: TypeAlias = dict[str, list[Binding]]


@dataclass(frozen=True, slots=True)
class Module:
    """A file's functions by first line and name, each with the scopes around it, and its global names."""

    functions: dict[tuple[int, str], list[BindingTable]]
    names: Names
    rebound: frozenset[str]  # names that some function declares global
    imports: tuple[ast.stmt, ...]  # a statement that imports all names that the module imports

    def is_bound_once(self, name: str) -> bool:
        """Whether the file gives this global name a value exactly once (or by one import, repeated)."""
        return name not in self.rebound and _is_settled(name, self.names.get(name, ()))


@dataclass(frozen=True, slots=True)
class Located:
    """A function's node, the scopes around it from the outermost inwards, and its file."""

    node: FunctionNode
    around: tuple[Owner, ...]
    module: Module
    whole: bool  # whether the file is that of the function's module, so that it shows every assignment

    def is_closure_bound_once(self, name: str) -> bool:
        """Whether a name of an enclosing function is given its value exactly once."""
        for owner in reversed(self.around):
            places = find_bindings(owner).get(name)
            if places is not None:
                inner = (node for node in ast.walk(owner) if isinstance(node, ast.Nonlocal))
                return _is_settled(name, places) and not any(name in node.names for node in inner)
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
    functions: dict[tuple[int, str], list[BindingTable]] = defaultdict(list)
    rebound: set[str] = set()
    pending: list[tuple[ast.AST, tuple[Owner, ...]]] = [(tree, ())]
    while pending:
        node, around = pending.pop()
        match node:
            case ast.Global(names=declared):
                rebound.update(declared)
            case ast.FunctionDef():
                first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
                functions[first, node.name].append((node, around))
                around = (*around, node)
            case ast.Lambda():
                functions[node.lineno, "<lambda>"].append((node, around))
                around = (*around, node)
            case ast.AsyncFunctionDef() | ast.ListComp() | ast.SetComp() | ast.DictComp() | ast.GeneratorExp():
                around = (*around, node)
        pending.extend((child, around) for child in ast.iter_child_nodes(node))
    names: Names = defaultdict(list)
    _scan_bindings(tree.body, names, False)
    aliases = [ast.alias(name) for name in names if name != "*" and any(place.how == "import" for place in names[name])]
    imports = (ast.fix_missing_locations(ast.Import(aliases)),) if aliases else ()
    return Module(dict(functions), dict(names), frozenset(rebound), imports)


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


def find_bindings(owner: Owner) -> Names:
    """Every name that is local to a function, lambda or comprehension, with the places that bind it."""
    found: Names = defaultdict(list)
    match owner:
        case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.Lambda():
            for parameter in list_parameters(owner.args):
                found[parameter.arg].append(Binding("parameter"))
            _scan_bindings([owner.body] if isinstance(owner, ast.Lambda) else owner.body, found, False)
        case _:
            for generator in owner.generators:
                _scan_bindings([generator.target], found, True)
    return dict(found)


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


def _is_settled(name: str, places: Sequence[Binding]) -> bool:
    if not places or any(place.looped or place.how in ("update", "error", "other") for place in places):
        return False
    return len(places) == 1 or len({_describe_bound_import(name, place) for place in places}) == 1


def _describe_bound_import(name: str, place: Binding) -> object:
    """What an import binds to a name: equal for imports of the same thing, else different."""
    match place.node:
        case ast.Import(names=aliases):
            # `import a` and `import a.b` both bind `a`.
            return next((alias.name for alias in aliases if alias.asname == name), name)
        case ast.ImportFrom(module=module, names=aliases, level=level):
            return level, module, next(alias.name for alias in aliases if (alias.asname or alias.name) == name)
        case _:
            return id(place)


def _scan_bindings(nodes: Sequence[ast.AST], found: Names, looped: bool) -> None:
    """Adds what `nodes` bind in their own scope, without the bodies of inner functions and classes."""
    for node in nodes:
        match node:
            case _ if type(node) not in _BINDING:
                _scan_bindings(list(ast.iter_child_nodes(node)), found, looped)
            case ast.Assign(value=value) | ast.AnnAssign(value=ast.expr() as value) | ast.NamedExpr(value=value):
                for whole in node.targets if isinstance(node, ast.Assign) else [node.target]:
                    for target, part in pair_targets(whole, value):
                        _bind_target(target, part, found, looped)
                _scan_bindings([value], found, looped)
            case ast.AugAssign(target=ast.Name(id=name), value=value):
                found[name].append(Binding("update", node, looped))
                _scan_bindings([value], found, looped)
            case (
                ast.FunctionDef(name=name, decorator_list=decorators)
                | ast.AsyncFunctionDef(name=name, decorator_list=decorators)
            ):
                plain = isinstance(node, ast.FunctionDef) and not decorators
                found[name].append(Binding("function", node, looped) if plain else Binding("value", None, looped))
                _scan_bindings([*decorators, node.args, *([node.returns] if node.returns else [])], found, looped)
            case ast.ClassDef(name=name, bases=bases, keywords=keywords, decorator_list=decorators):
                found[name].append(Binding("value", None, looped))
                _scan_bindings([*decorators, *bases, *keywords], found, looped)
            case ast.Lambda(args=arguments):
                _scan_bindings([arguments], found, looped)
            case ast.ListComp() | ast.SetComp() | ast.DictComp() | ast.GeneratorExp():
                # The targets are local to the comprehension, but `:=` inside it binds out here.
                inner: Names = defaultdict(list)
                _scan_bindings(list(ast.iter_child_nodes(node)), inner, True)
                for name in inner:
                    found[name].append(Binding("other", None, True))
            case ast.comprehension(iter=iterable, ifs=conditions):
                _scan_bindings([iterable, *conditions], found, True)
            case ast.Import(names=aliases) | ast.ImportFrom(names=aliases):
                for alias in aliases:
                    name = alias.asname or alias.name.partition(".")[0]
                    found[name].append(Binding("import", node, looped))
            case ast.Name(id=name, ctx=ast.Store() | ast.Del()):
                found[name].append(Binding("other", None, looped))
            case ast.ExceptHandler(type=ast.expr() as error, name=str(name), body=body):
                found[name].append(Binding("error", None, looped))
                _scan_bindings([error, *body], found, looped)
            case ast.MatchAs(name=str(name)) | ast.MatchStar(name=str(name)) | ast.MatchMapping(rest=str(name)):
                found[name].append(Binding("other", None, looped))
                _scan_bindings(list(ast.iter_child_nodes(node)), found, looped)
            case _:
                looping = looped or isinstance(node, ast.For | ast.AsyncFor | ast.While)
                _scan_bindings(list(ast.iter_child_nodes(node)), found, looping)


def _bind_target(target: ast.expr, value: ast.expr | None, found: Names, looped: bool) -> None:
    if isinstance(target, ast.Name):
        found[target.id].append(Binding("value" if value is not None else "other", value, looped))
    else:
        _scan_bindings([target], found, looped)
