"""One piece of generated code, its functions under construction, and what is known of the expressions in it.

A CodegenContext becomes one Python function, `bound(run)`. It binds what a run offers (functions of the user, values of
variables), defines a function for every query inside, and returns what it is for. `PythonScope` is a function
under construction. Values that need not be computed again are kept in *slots*: a slot belongs to the
outermost function and loop where everything that its expression reads is known, and is filled when the
expression is first needed. So nothing is evaluated that the written order would not evaluate.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import field
from types import CodeType, FunctionType
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Error, Span, Stopped
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.operations import GROUPS, OPERATIONS
from ss2sql.language.plan_traversal import list_parts
from ss2sql.language.values import UNSET
from ss2sql.runtime.python.located_code import PAGE, AstBuilder, CodePage
from ss2sql.runtime.python.query_execution import make_step_meter, make_turn_check
from ss2sql.runtime.run.run_state import Run

if TYPE_CHECKING:
    from ss2sql.runtime.python.single_calls import SingleSourceCall
    from ss2sql.runtime.search.search_run import FindPaths


# --- what the compiler knows of an expression: what it depends on, and whether its evaluation could be noticed
@dataclass(frozen=True, slots=True)
class ExpressionFacts:
    """Facts of one node of a plan."""

    sources: frozenset[int] = frozenset()  # that it reads, nested queries included
    states: frozenset[tuple[int, str]] = frozenset()  # START WITH variables that it reads, likewise
    groups: frozenset[int] = frozenset()  # queries whose groups it reads; OWN_GROUP: aggregates
    steady: bool = True  # has no effect and one value per row, however often it is evaluated; it may raise
    total: bool = True  # cannot raise
    key: int | None = None  # equal for expressions of the same text and meaning; None: not known
    calls: bool = False  # contains a call of a user function, or a query


OWN_GROUP = -1
_NONE: frozenset[int] = frozenset()
_NO_STATES: frozenset[tuple[int, str]] = frozenset()


class ExpressionAnalysis:
    """The facts of everything below some nodes of a plan.

    With `open_world`, or where there is an `eval` or a late list, any variable may change at any time; else
    only those that are assigned below the nodes. `inside` says whether to look into queries, too.
    """

    def __init__(self, roots: tuple[Any, ...], open_world: bool = False, inside: bool = True) -> None:
        self._facts: dict[int, ExpressionFacts] = {}
        self._keys: dict[Hashable, int] = {}
        self._plain: set[int] = set()  # sources whose elements are no objects
        self._inside = inside
        self.open_world = open_world
        self.assigned: set[str] = set()
        self.roots: tuple[Any, ...] = ()
        self.levels = 0
        self.add_roots(roots)

    def add_roots(self, roots: tuple[Any, ...]) -> None:
        """Finds the facts of what is below further nodes."""
        self.roots += roots  # kept alive, for facts go by identity
        nodes: list[tuple[Any, list[Any]]] = []
        stack = list(roots)
        while stack:
            node = stack.pop()
            below = [] if isinstance(node, plan.Subquery) and not self._inside else list(list_parts(node))
            nodes.append((node, below))
            stack.extend(below)
        for node, _ in nodes:
            match node:
                case plan.Assign(name=name) | plan.TemporalAssign(name=name):
                    self.assigned.add(name)
                case plan.Eval() | plan.AssignLate():
                    self.open_world = True
                case plan.ValueSource(id=number, element=element) | plan.QuerySource(id=number, element=element):
                    if not element.may_be(Kind.OBJECT):
                        self._plain.add(number)
                case plan.TableSource(id=number) | plan.WorldSource(id=number):
                    self._plain.add(number)
        depths: dict[int, int] = {}
        for node, below in reversed(nodes):
            depths[id(node)] = 1 + max((depths[id(part)] for part in below), default=0)
            if id(node) not in self._facts:
                self._facts[id(node)] = self._find_facts(node, [self._facts[id(part)] for part in below])
        self.levels = max([self.levels, *(depths[id(root)] for root in roots)])

    def facts(self, node: Any) -> ExpressionFacts:
        """The facts of a node below the roots; any other node is a constant of the compiler's."""
        return self._facts.get(id(node)) or ExpressionFacts()

    def are_steady(self, nodes: Iterable[Any]) -> bool:
        return all(self.facts(node).steady for node in nodes)

    def is_fixed(self, variable: str) -> bool:
        """Whether a script variable keeps its value while the nodes run."""
        return not self.open_world and variable not in self.assigned

    def _find_facts(self, node: Any, below: list[ExpressionFacts]) -> ExpressionFacts:
        sources, states, groups = _NONE, _NO_STATES, _NONE
        steady = total = True
        calls = False
        for part in below:
            calls = calls or part.calls
            sources |= part.sources
            states |= part.states
            groups |= part.groups
            steady = steady and part.steady
            total = total and part.total
        match node:
            case plan.Variable(name=name):
                steady = self.is_fixed(name)
            case plan.Element(source=source):
                sources = frozenset({source})
            case plan.Column(source=source, declared=declared):
                sources, total = frozenset({source}), declared and source in self._plain
            case plan.State(query=query, name=name):
                states = frozenset({(query, name)})
            case plan.Call(function=function):
                steady = steady and function.volatility != "volatile"
                total = total and function.builtin and not function.raises
                calls = calls or not function.builtin
            case plan.And(parts=tested) | plan.Or(parts=tested):
                total = total and all(map(_has_plain_truth, tested))
            case plan.Xor(left=left, right=right):
                total = total and _has_plain_truth(left) and _has_plain_truth(right)
            case plan.Not(operand=tested) | plan.If(condition=tested):
                total = total and _has_plain_truth(tested)
            case plan.GroupKey(query=query):
                groups = frozenset({query})
            case plan.Aggregate(function=name, argument=argument):
                fails = argument is not None and GROUPS[name].can_fail(argument.type)
                groups, total = frozenset({OWN_GROUP}), total and not fails
            case plan.Query(id=query):
                groups -= {query, OWN_GROUP}
            case plan.Subquery():
                total, calls = False, True
            case plan.Eval(sources=seen, states=seen_states):
                sources, states = sources | set(seen), states | set(seen_states)
                steady = total = False
            case plan.Temporal() | plan.Assign() | plan.TemporalAssign() | plan.AssignLate():
                steady = total = False
        return ExpressionFacts(sources, states, groups, steady, total, self._number_meaning(node, below), calls)

    def _number_meaning(self, node: Any, below: list[ExpressionFacts]) -> int | None:
        """A number for the meaning of the expression: that of its first appearance."""
        inner = [part.key for part in below]
        if None in inner:
            return None
        own: tuple[Hashable, ...]
        match node:
            case plan.Constant(value=value):
                own = (repr(value),)
            case plan.Variable(name=name, frame=frame):
                own = (name, frame)
            case plan.Element(source=source):
                own = (source,)
            case plan.Column(source=source, name=name, declared=declared):
                own = (source, name, declared)
            case plan.State(query=query, name=name):
                own = (query, name)
            case plan.Call(function=function):
                own = (function.name, function.builtin)
            case plan.If(then=then):
                own = (len(then),)
            case plan.Aggregate(function=name):
                own = (name,)
            case plan.And() | plan.Or() | plan.Xor() | plan.Not() | plan.MakeList():
                own = ()
            case _:
                return None
        return self._keys.setdefault((type(node), own, *inner), len(self._keys))


def _has_plain_truth(expr: plan.Expr) -> bool:
    """Whether asking for the truth of the value cannot fail; an object may have its own ideas."""
    return not expr.type.may_be(Kind.OBJECT)


# --- one piece of generated code, its functions under construction, and the values that they keep
COUNTERS = ("generated", "expanded", "pruned")
MAX_LOOPS = 16  # Python refuses more than 20 blocks inside of each other


class MissingValueError(Exception):
    """A variable has no value when its query starts; whoever reads it then gets Python's NameError."""


def _list_names(values: Sequence[ast.expr]) -> tuple[str, ...]:
    """The names that the values are; none where one is something else."""
    names = tuple([value.id for value in values if isinstance(value, ast.Name)])
    return names if len(names) == len(values) else ()


@dataclass(slots=True)
class PythonScope:
    """A generated function under construction."""

    codegen: CodegenContext
    name: str
    parameters: list[str]
    parent: PythonScope | None
    blocks: list[list[ast.stmt]] = field(default_factory=lambda: [[]])  # statements, of each open loop, too
    levels: dict[int, int] = field(default_factory=dict)  # source -> the loop that binds it; 0: a parameter
    states: set[tuple[int, str]] = field(default_factory=set)  # START WITH variables that are bound here
    moved: dict[tuple[int, str], str] = field(default_factory=dict)  # changed by CONNECT BY -> their new names
    groups: dict[tuple[int, int], str] = field(default_factory=dict)  # values of groups -> names, see get_group_key
    group_level: int = 0  # the loop that binds them
    shared: dict[str, None] = field(default_factory=dict)  # names of outer functions that are set here
    locals: list[str] = field(default_factory=list)  # names that are set here and read in inner functions
    counts: Counter[int] = field(default_factory=Counter)  # expression -> how often it is written here
    slots: dict[int, str] = field(default_factory=dict)  # expression -> the name that keeps its value
    known: list[dict[int, str]] = field(default_factory=lambda: [{}])  # by loop: what was certainly computed
    forgotten_values: dict[int, ast.expr] = field(default_factory=dict)  # like `known`, by identity
    packed: dict[tuple[str, ...], str] = field(default_factory=dict)  # names -> that of a tuple of their values
    before: PythonScope | None = None  # the function that this one continues
    sure: bool = True  # whether what is being written is certainly evaluated
    find_arguments: Callable[[plan.Call], str | None] = lambda call: None  # names what gives those of calls to come

    def is_source_visible(self, source: int) -> bool:
        """Whether a source is bound here or in a function around this one."""
        return source in self.levels or (self.parent is not None and self.parent.is_source_visible(source))

    def is_state_visible(self, state: tuple[int, str]) -> bool:
        """Whether a START WITH variable is bound here or in a function around this one."""
        return state in self.states or (self.parent is not None and self.parent.is_state_visible(state))

    @property
    def list_visible_groups(self) -> dict[tuple[int, int], str]:
        """The names of the values of groups that are bound here or in a function around this one."""
        return self.groups if self.parent is None else {**self.parent.list_visible_groups, **self.groups}

    @property
    def level(self) -> int:
        return len(self.blocks) - 1

    def emit(self, *statements: ast.stmt) -> None:
        """Statements for the innermost open loop."""
        self.blocks[-1].extend(statements)

    def find_home(self, facts: ExpressionFacts) -> tuple[PythonScope, int]:
        """The outermost function and loop where everything is known that the facts' expression reads."""
        levels = [self.levels[source] for source in facts.sources if source in self.levels]
        levels += [self.group_level for query, _ in self.groups if query in facts.groups]
        if levels or not self.states.isdisjoint(facts.states):
            return self, max(levels, default=0)
        return (self, 0) if self.parent is None else self.parent.find_home(facts)

    def compute_once(self, facts: ExpressionFacts, value: ast.expr, build: AstBuilder, hint: str) -> ast.expr:
        """The value, computed at most once for each turn of its home's loop; the facts are of a steady node.

        Equal expressions share a slot. What is read only once, right at home, needs none.
        """
        home, level = self.find_home(facts)
        if self.has_state_changed(facts):
            return value
        if home is self and level == self.level:
            slot = facts.key is not None and home.slots.get(facts.key)
            if facts.key is None or self.counts[facts.key] < 2 or (self.sure and not slot):
                return self.name_if_repeated(facts, value, build, hint)
        name = home.slots.get(facts.key) if facts.key is not None else None
        if name is None:
            name = self.codegen.new_name(hint)
            home.blocks[level].insert(0, build.assign(name, build.name("UNSET")))
            if facts.key is not None:
                home.slots[facts.key] = name
        if home is not self:
            self.shared[name] = None
        self.forget_names(value)
        if self.sure and facts.key is not None:
            self.known[-1][facts.key] = name
        fresh = build.compare(build.name(name), ast.IsNot(), build.name("UNSET"))
        return build.if_else(fresh, build.name(name), build.bind(name, value))

    def forget_names(self, value: ast.expr) -> None:
        """No longer knows the names that are set in a value, which may be skipped: they would keep older values.

        Those within a value in it are forgotten already; 240 calls in each other took 3 s when all were walked again.
        """
        inside: set[str] = set()
        ahead: list[ast.AST] = [value]
        while ahead:
            node = ahead.pop()
            if isinstance(node, ast.NamedExpr):
                inside.add(node.target.id)
            if id(node) not in self.forgotten_values:
                ahead.extend(ast.iter_child_nodes(node))
        self.forgotten_values[id(value)] = value
        for names in self.known:
            for key in [key for key, name in names.items() if name in inside]:
                del names[key]

    def name_if_repeated(self, facts: ExpressionFacts, value: ast.expr, build: AstBuilder, hint: str) -> ast.expr:
        """The value, with a name where it is certain to be computed here and is written again further down."""
        if facts.key is None or self.counts[facts.key] < 2 or not self.sure or self.has_state_changed(facts):
            return value
        name = self.known[-1][facts.key] = self.codegen.new_name(hint)
        return build.bind(name, value)

    def pack(self, values: Sequence[ast.expr], build: AstBuilder) -> ast.expr:
        """A tuple of the values, which there may be already."""
        name = self.packed.get(_list_names(values))
        return build.pack(*values) if name is None else build.name(name)

    def assign_tuple(self, name: str, values: Sequence[ast.expr], build: AstBuilder) -> None:
        """Gives a tuple of the values a name, which stands for it from here on."""
        self.emit(build.assign(name, build.pack(*values)))
        if self.sure and _list_names(values):
            self.packed[_list_names(values)] = name

    def name_or_constant(self, value: ast.expr, build: AstBuilder, hint: str) -> ast.expr:
        """A name or a constant that stands for the value."""
        return value if isinstance(value, ast.Constant) else build.name(self.assign_name(value, build, hint))

    def assign_name(self, value: ast.expr, build: AstBuilder, hint: str) -> str:
        """The name of a value, which is computed here unless it has one already."""
        if isinstance(value, ast.Name):
            return value.id
        if isinstance(value, ast.NamedExpr):
            name, value = value.target.id, value.value
        else:
            name = self.codegen.new_name(hint)
        self.emit(build.assign(name, value))
        return name

    def name_of(self, facts: ExpressionFacts) -> str | None:
        """The name of a value that has been computed already, wherever this place is reached."""
        if facts.key is None or self.has_state_changed(facts):
            return None
        return next((names[facts.key] for names in self.known if facts.key in names), None)

    def has_state_changed(self, facts: ExpressionFacts) -> bool:
        """Whether CONNECT BY has changed what the expression reads."""
        return not facts.states.isdisjoint(self.moved)

    @contextmanager
    def write_skippable(self) -> Iterator[None]:
        """For the time of writing what may be skipped when the code runs."""
        before, self.sure = self.sure, False
        yield
        self.sure = before

    def open_loop(self, names: list[str], items: ast.expr, build: AstBuilder) -> None:
        """Opens a loop over items, which are tuples where there are several names."""
        inner: list[ast.stmt] = []
        self.emit(build.loop(names, items, inner))
        self.blocks.append(inner)
        self.known.append({})
        self.locals.extend(names)

    def count_uses(self, nodes: Iterable[Any]) -> None:
        """Notes which expressions will be evaluated in this function, and how often they are written.

        What stands only inside of a cheap expression that is written twice is computed once, with it.
        """
        stack = list(nodes)
        while stack:
            node = stack.pop()
            facts = self.codegen.analysis.facts(node)
            if facts.key is not None:
                self.counts[facts.key] += 1
            again = facts.key is not None and self.counts[facts.key] > 1 and not facts.calls
            if not isinstance(node, plan.Subquery) and not again:
                stack.extend(list_parts(node))

    def build_function(self, build: AstBuilder) -> ast.stmt:
        statements = self.blocks[0] or [build.run(build.constant(None))]
        if self.shared:
            statements = [ast.Nonlocal(list(self.shared), **build.at), *statements]
        return build.function(self.name, self.parameters, statements)

    def define_function(self) -> None:
        """Puts the finished function into the one around it."""
        assert self.parent is not None
        if self.before is not None:
            self.before.define_function()
        if self.parent is self.codegen.root:
            self.codegen.definitions.append(self.build_function(self.codegen.build))
        else:
            self.parent.emit(self.build_function(self.codegen.build))


class CodegenContext:
    """One piece of generated code."""

    def __init__(self, span: Span, analysis: ExpressionAnalysis) -> None:
        self.page = CodePage(span.source)
        self.namespace: dict[str, Any] = {"__name__": __name__, PAGE: self.page, "UNSET": UNSET, "Stopped": Stopped}
        self.build = self.build_at(span)
        self.analysis = analysis
        self.root = PythonScope(self, "bound", ["run"], None)
        self.names: dict[int, str] = {}  # source -> its local name
        self.states: dict[tuple[int, str], str] = {}  # START WITH variable -> its local name
        self.tuples: dict[int, tuple[str, ...]] = {}  # source whose elements are tuples -> their columns
        self.row_orders: dict[int, str] = {}  # by query: what tells whether its rows come in the order of ORDER BY
        self.single_column_queries: set[int] = set()  # of these, sources whose name stands for their only column
        self.elements: dict[int, Type] = {}  # source whose elements are values -> their type
        self.worlds: dict[int, Any] = {}  # source that walks keys of a world -> its table
        self.keys: dict[int, str] = {}  # source -> the name of its elements' exact keys, see run/calls.py
        self.bindings: list[ast.stmt] = []
        self.definitions: list[ast.stmt] = []
        self.source_call: SingleSourceCall | None = None  # the call of a source that a search makes once for each state
        self.watched: plan.Query | None = None  # the search that trace.py hears of
        self.level_searched_query: plan.Query | None = None  # the search whose results `find` finds
        self.find: FindPaths | None = None
        self.guarded_arguments: set[int] = set()  # of aggregates that may not be computed, by id: those that may fail
        self._bound: dict[Any, str] = {}
        self._count = 0

    def build_at(self, span: Span) -> AstBuilder:
        return AstBuilder(self.page.add_span(span), self.namespace)

    # --- names -----------------------------------------------------------------------------------------

    def new_name(self, hint: str) -> str:
        """A new name, with a hint for the reader; its number keeps it apart from every other."""
        self._count += 1
        return f"{hint if hint.isascii() and hint.isidentifier() else 'name'}_{self._count}"

    def embed(self, value: Any, hint: str = "constant") -> str:
        """A name for an object of the compiler's."""
        name = self.new_name(hint)
        self.namespace[name] = value
        return name

    def use(self, function: Callable[..., Any]) -> str:
        """The name of a function of the library."""
        return self.build.use(function)

    def bind(self, key: Any, hint: str, value: ast.expr, build: AstBuilder, text: str = "name = value") -> str:
        """A name for a value that is computed once, when a run begins, by the statement that the text is."""
        if key not in self._bound:
            name = self._bound[key] = self.new_name(hint)
            self.bindings += build.write(text, name=name, value=value)
        return self._bound[key]

    def name_function(self, function: plan.Function, build: AstBuilder) -> str:
        """A name for the callable of a function of the plan."""
        key = (function.name, function.builtin)
        if key not in self._bound:
            python = OPERATIONS[function.name].value if function.builtin else None
            if python is not None and not OPERATIONS[function.name].grows:
                self._bound[key] = self.embed(python, function.name)
            else:
                constant = self.embed(function, "function")
                found = build.express("run.host.get_callable(constant, run)", constant=constant)
                self.bind(key, function.name, found, build)
        return self._bound[key]

    def read_sizes(self, part: str, build: AstBuilder) -> ast.expr:
        """What measures the values that are made, or a number that it goes by."""
        return build.name(self.bind(("sizes", part), part, build.express(f"run.sizes.{part}"), build))

    def read_variable(self, name: str, build: AstBuilder) -> ast.expr:
        """The value of a script variable: read once where nothing in this code changes it, else each time."""
        text = build.constant(name)
        if not self.analysis.is_fixed(name):
            return build.express("run.get_variable(text)", text=text)
        self.use(MissingValueError)
        value = build.express("read(run, text)", read=get_run_variable_if_set, text=text)
        attempt = "try: name = value\nexcept MissingValueError: pass"
        return build.name(self.bind(("variable", name), name, value, build, attempt))

    def read_frame(self, name: str, build: AstBuilder) -> ast.expr:
        """A data frame, as it was when the run first read it."""
        return build.express("run.get_source(name)", name=build.constant(name))

    def name_counter(self, name: str, body: PythonScope) -> str:
        """A counter of the whole run, to be increased in `body`."""
        if name not in self._bound:
            self._bound[name] = name
            self.bindings.append(self.build.assign(name, self.build.constant(0)))
        if body is not self.root:
            body.shared[name] = None
        return name

    def write_turn_check(self, counter: str) -> ast.expr:
        """A call that ends the run if it has to end; its value is the count at which to ask again."""
        made = self.build.express("make(run)", make=make_turn_check)
        turn_check = self.bind("turn_check", "turn_check", made, self.build)
        return self.build.express("check(counter)", check=turn_check, counter=counter)

    def read_step_meter(self) -> ast.expr:
        """What does the same for the steps of searches, and hands on what they have counted."""
        made = self.build.express("make(run)", make=make_step_meter)
        return self.build.name(self.bind("meter", "meter", made, self.build))

    # --- the end ---------------------------------------------------------------------------------------

    def build_module(self, result: ast.expr) -> ast.Module:
        """The code, whose function `bound` gives `result`."""
        # Slots stand in the root's block; what they are filled with comes later.
        self.root.blocks[0].extend((*self.bindings, *self.definitions, self.build.return_(result)))
        return ast.Module([self.root.build_function(self.build)], [])

    def compile_module(self, module: ast.Module) -> Callable[..., Any]:
        """The function `bound` of the generated module."""
        code = compile(module, self.page.name, "exec", dont_inherit=True)
        inner = next(constant for constant in code.co_consts if isinstance(constant, CodeType))
        return FunctionType(inner, self.namespace)


def get_run_variable_if_set(run: Run, name: str) -> Any:
    """The value of a variable when a query starts; MissingValueError where it has none yet."""
    try:
        return run.get_variable(name)
    except Error as error:
        if error.code == "R001":
            raise MissingValueError from None
        raise
