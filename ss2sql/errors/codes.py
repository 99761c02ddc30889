"""The table of codes: what each kind of error means. Why it is one, and what to do, is on its page."""

from __future__ import annotations

from ss2sql.fast_dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Code:
    """One kind of error; `explanation` says what has happened."""

    code: str
    title: str
    explanation: str

    @property
    def page(self) -> str:
        """The page about it, from the root of the project."""
        return f"docs/errors/{self.code}.md"


def _make_code_table(*rows: tuple[str, str, str]) -> dict[str, Code]:
    return {row[0]: Code(*row) for row in rows}


CODES: dict[str, Code] = _make_code_table(
    ("P001", "unexpected text", "The text does not fit the grammar at this place."),
    ("P002", "unexpected end", "The script ends before a statement is complete, most often a missing parenthesis."),
    ("P003", "unreadable text",
     "A character, string or comment that the language does not have or that is not closed."),
    ("P004", "script too large", "A script may have at most 256 KiB."),
    ("P005", "nested too deeply",
     "Lists, calls, queries and operators nested deeper than 300 levels are refused, and so are chains of one "
     "operator with more than 300 operands."),
    ("P006", "a spelling of another language",
     "SQL or Python writes this differently from SelectScript; the error shows the right form."),
    ("P007", "number out of range", "Integers have 64 bits, floats are finite."),
    ("P008", "empty script", "There is no statement to run."),
    ("P009", "unclosed inner query", "A query inside another has to be in parentheses or end with AS."),
    ("R001", "unknown name", "No variable, column or START WITH variable has this name here."),
    ("R002", "unknown function", "No function of this name is built in or registered."),
    ("R003", "unknown source", "FROM names something that is neither a variable, a table nor a world."),
    ("R004", "ambiguous name", "Two sources have a column of this name: write `source.column`."),
    ("R005", "wrong number of arguments", "The function takes another number of arguments."),
    ("R006", "unknown representation", "AS names a representation that nobody registered."),
    ("R007", "assignment to a search variable", "A START WITH variable is changed in CONNECT BY only."),
    ("R008", "aggregate in the wrong place", "Aggregates work on lists, or on groups inside GROUP BY."),
    ("R009", "missing parameter", "The compiled script has names that must be given a value when it runs."),
    ("R010", "contradictory options", "These options of CONNECT BY do not go together."),
    ("R011", "late list outside its query",
     "A list that mentions `a.this` can only be read by a query with the source a."),
    ("R012", "incomplete search", "START WITH, STOP WITH, SELECT LAST and ORDER SIBLINGS BY need CONNECT BY."),
    ("R013", "repeated name", "Two sources, clauses or variables of one query have the same name."),
    ("R014", "misplaced construct", "The construct exists, but not in this place."),
    ("U001", "not possible in the database",
     "The engine `database`, `duckdb` or `spark` was to run what only runs elsewhere."),
    ("X001", "operands do not fit", "The operator does not work on values of these types."),
    ("X002", "division by zero", "The right operand of / or % is zero."),
    ("X003", "index out of range", "The list is shorter than the index, or the dict lacks the key."),
    ("X004", "value not allowed", "NaN, infinities, complex numbers and integers beyond 64 bits are refused."),
    ("X005", "not a source", "FROM needs a list, a dict of columns, a table, a world or a query."),
    ("X006", "wrong option value",
     "MAXIMUM, MEMORIZE, LIMIT, COST, HEURISTIC or PROBABILITY got a value out of range."),
    ("X007", "wrong argument", "A built-in function got an argument that it cannot use."),
    ("X008", "missing column", "A row lacks a column that the query reads."),
    ("X009", "database error", "SQLite refused or broke off a statement."),
    ("X010", "row limit", "The query has more rows than max_rows allows."),
    ("X011", "world cannot be read", "A simulator refused, an element is gone, or a table breaks its declarations."),
    ("X012", "wrong block", "A function that takes arrays has to return one element for each row."),
    ("X013", "worker died", "A process that was to call functions, as `workers` asks for, ended by itself."),
    ("X014", "value too large", "The script made a text, list or dict of more bytes than `max_size` allows."),
    ("X015", "too much output", "The script printed more characters than `max_output` allows."),
    ("X016", "eval inside of eval", "A script that `eval` runs calls `eval` again, and so on, thirty levels deep."),
    ("V001", "representation failed", "The rows do not fit the representation, or its arguments are wrong."),
    ("T001", "timeout", "The run took longer than its timeout."),
    ("T002", "cancelled", "The run was interrupted."),
    ("T003", "out of memory", "The run took more memory than it may, `max_memory`, or than there is."),
    ("T004", "out of steps", "The searches of the run tried more steps than `max_steps` allows."),
    ("S001", "session is closed", "A closed session cannot run scripts."),
    ("S002", "wrong registration", "A function, variable, table or representation cannot be registered like this."),
    ("S003", "missing package", "The call needs a package that is not installed; the error shows how to install it."),
    ("S004", "session in use",
     "The session is in use in another thread, or belongs to the process that this one is a copy of."),
    ("S005", "file is open in another SQLite",
     "The file is open in this process in another copy of SQLite, such as that of Python's `sqlite3`."),
)  # fmt: skip
