"""Which graph a search works on, and the hashes of the functions that it calls.

A graph is told from others by the texts of FROM, SELECT and CONNECT BY, the names in START WITH, and the functions that
these call. Where a search starts, when it stops and what it looks for makes no other graph.

What is remembered of a function goes by its hash, so nothing else has to be the same for it to be right.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import cache
from hashlib import sha256
from itertools import chain
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Error
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.plan_traversal import list_plan_functions, walk
from ss2sql.runtime.graph_cache.function_fingerprint import NotCacheable, fingerprint_function
from ss2sql.vtables.contract import World

if TYPE_CHECKING:
    from ss2sql.frontend.user_functions import UserFunction
    from ss2sql.vtables.attached_worlds import AttachedWorld


FORMAT = 2  # another one makes other graphs of everything


@dataclass(frozen=True, slots=True)
class GraphIdentity:
    """The key of a graph, and the functions of a search: by their names in plans their names with their hashes.

    `steps` are the functions that make its steps.
    """

    key: str
    functions: dict[str, str]
    steps: tuple[str, ...]


def identify_graph(
    query: plan.Query, get_function: Callable[[str], UserFunction], worlds: Callable[[], Iterable[AttachedWorld]]
) -> GraphIdentity:
    """The identity of the graph of a search. Raises NotCacheable where a function cannot be told from others."""
    search = query.search
    assert search is not None
    digest_worlds = cache(lambda: _hash_parts(*(digest_world(attached.world) for attached in worlds())))
    functions: dict[str, str] = {}
    for one in _list_user_functions(query):
        if one.name not in functions:
            functions[one.name] = _hash_function(one, get_function, digest_worlds)
    parts = list(list_step_parts(query))
    steps = tuple(dict.fromkeys(one.name for part in parts for one in _list_user_functions(part)))
    texts = [" ".join(part.span.text.split()) for part in parts]
    names = [name for name, _ in (*search.start, *search.connect)]
    return GraphIdentity(_hash_parts(FORMAT, texts, names, [functions[name] for name in steps]), functions, steps)


def list_step_parts(query: plan.Query) -> Iterator[plan.Source | plan.Expr]:
    """The parts of a search that make its steps: those of FROM, SELECT and CONNECT BY."""
    assert query.search is not None
    outputs = query.rows if query.aggregated else (output.expr for output in query.columns)
    return chain(query.sources, outputs, (expr for _, expr in query.search.connect))


def list_step_variables(query: plan.Query) -> list[str]:
    """The script variables that the steps of a search read."""
    nodes = chain.from_iterable(map(walk, list_step_parts(query)))
    return list(dict.fromkeys(node.name for node in nodes if isinstance(node, plan.Variable)))


def do_steps_call_user(query: plan.Query) -> bool:
    """Whether a search calls functions of the user in its steps, or to judge them."""
    assert query.search is not None
    clauses = (query.where, query.search.stop, query.search.weight)
    parts = chain(list_step_parts(query), (clause for clause in clauses if clause is not None))
    return any(True for part in parts for _ in _list_user_functions(part))


def _list_user_functions(node: Any) -> Iterator[plan.Function]:
    return (function for function in list_plan_functions(node) if not function.builtin)


def _hash_function(
    function: plan.Function, get_function: Callable[[str], UserFunction], digest_worlds: Callable[[], str]
) -> str:
    """The name of a function with the hash of what it computes; those of worlds may read elements of any."""
    name = function.of_world or function.name
    if function.vectorized:
        raise NotCacheable(f"'{name}' takes arrays")
    if function.of_world:
        return f"{name} {digest_worlds()[:16]}"
    if function.volatility != "immutable":
        raise NotCacheable(f"'{name}' is {function.volatility}, not immutable")
    try:
        return f"{name} {fingerprint_function(get_function(function.name).function)[:16]}"
    except NotCacheable as reason:
        raise NotCacheable(f"'{name}' {reason}") from None


def digest_world(world: World) -> str:
    """The digest of a world's contents and of its class."""
    kind = type(world)
    try:
        found = world.fingerprint()
    except Error:
        raise
    except Exception as error:  # whatever an adapter raises
        raise NotCacheable(f"{kind.__name__} cannot be compared: {error}") from error
    try:
        return _hash_parts(fingerprint_function(kind), found)
    except NotCacheable as reason:
        raise NotCacheable(f"{kind.__name__}, the class of a world, {reason}") from None


def _hash_parts(*parts: Any) -> str:
    return sha256(repr(parts).encode("utf-8", "surrogatepass")).hexdigest()
