"""The table of codes: what each kind of error means, why it is one, and what to do about it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Code:
    """One kind of error: what `ss2sql list errors` and its page say of it.

    `explanation` says what has happened, `why` why the language does not go on, `cure` what to do.
    """

    code: str
    title: str
    explanation: str
    why: str
    cure: str

    @property
    def page(self) -> str:
        """The page about it, from the root of the project."""
        return f"docs/errors/{self.code}.md"


def _table(*rows: tuple[str, str, str, str, str]) -> dict[str, Code]:
    return {row[0]: Code(*row) for row in rows}


CODES: dict[str, Code] = _table(
    (
        "P001", "unexpected text",
        "The text does not fit the grammar at this place.",
        "What stands in front of the mark was read without trouble; with the marked word it cannot become a statement. "
        "The mistake is often a little before it: a missing comma, semicolon, operator or parenthesis.",
        "Look at the mark and at what the message expected there. Clauses have a fixed order: SELECT, FROM, WHERE, "
        "START WITH, CONNECT BY, STOP WITH, then GROUP BY, ORDER BY and LIMIT, and AS at the end.",
    ),
    (
        "P002", "unexpected end",
        "The script ends before a statement is complete, most often a missing parenthesis.",
        "Every bracket has to be closed, and every operator and clause needs what follows it.",
        "Close the bracket that the message marks, or write what is missing at the end.",
    ),
    (
        "P003", "unreadable text",
        "A character, string or comment that the language does not have or that is not closed.",
        "Before a script is understood it is cut into words, numbers, strings and signs; this is none of them.",
        "Close strings on their own line with the quote that opened them, and comments with `*/`. Names consist of "
        "letters, digits and `_`; any other text stands in quotes.",
    ),
    (
        "P004", "script too large",
        "A script may have at most 256 KiB.",
        "Such texts are nearly always data. Read as a script they would take long, and every number would be a node of "
        "a tree.",
        "Give data to the session from Python: `session.attach(name, list)`, or a variable of `run`.",
    ),
    (
        "P005", "nested too deeply",
        "Parentheses, queries or operators nested deeper than 200 are refused, and so are chains of one operator with "
        "more than 300 operands.",
        "A script is walked by functions that call themselves, and the stack of a process is limited; a refusal is "
        "better than a crash.",
        "Assign inner parts to variables. Long sums are written `sum([...])`, long alternatives `x IN [...]`.",
    ),
    (
        "P006", "a spelling of another language",
        "SQL or Python writes this differently from SelectScript; the error shows the right form.",
        "SelectScript borrows most of its words from SQL and most of its values from Python, but not every word of "
        "both: `=` assigns and `==` compares, `AS` says the form of the result, there is no JOIN.",
        "Write the form that the message shows.",
    ),
    (
        "P007", "number out of range",
        "Integers have 64 bits, floats are finite.",
        "A number that no value can hold would have to be rounded silently.",
        "Write it as a float if it need not be exact, or in smaller units.",
    ),
    (
        "P008", "empty script",
        "There is no statement to run.",
        "The value of a script is that of its last statement, so there has to be one.",
        "Write a statement. If the text came from a file or a variable, see whether it is the right one.",
    ),
    (
        "P009", "unclosed inner query",
        "A query inside another stands in parentheses or ends with AS.",
        "Every comma and clause belongs to the innermost query that is not ended, so nobody could tell where it stops.",
        "Put the inner query into parentheses, or end it with `AS list` or another form.",
    ),
    (
        "R001", "unknown name",
        "No variable, column or START WITH variable of this name is in sight.",
        "Names are looked up before the first statement runs, so that a slip is found at once and not after an hour.",
        "Correct the spelling; capitals matter. A text stands in quotes. A value from Python is given by "
        "`run(script, name=value)`. A column of another source is written `source.column`.",
    ),
    (
        "R002", "unknown function",
        "No function of this name is built in or registered.",
        "Scripts cannot define functions; they call those of Python that the session was given.",
        "Register the function with `session.function`, or on the command line with `--functions FILE.py`. `help()` "
        "lists those there are. Values have no methods: write `f(x)`, not `x.f()`.",
    ),
    (
        "R003", "unknown source",
        "FROM names something that is neither a variable, a table nor a world.",
        "What FROM walks has to be there before the query starts.",
        "Assign a list to the name, attach the data with `session.attach(name, data)`, or correct the spelling.",
    ),
    (
        "R004", "ambiguous name",
        "Two sources have a column of this name: write `source.column`.",
        "The query would mean one thing or another, depending on the order of the sources.",
        "Write the source in front of the column. Two uses of one source get names: `FROM a = people, b = people`.",
    ),
    (
        "R005", "wrong number of arguments",
        "The function takes another number of arguments.",
        "Calls are checked before the script runs, from the signature of the function.",
        "See how it is called: `help('name')` says it. The arguments of IF are separated by semicolons.",
    ),
    (
        "R006", "unknown representation",
        "AS names a representation that nobody registered.",
        "AS stands at the end of a query and says what becomes of its rows; it names no column and no source.",
        "Choose one of the forms that the message lists, or register one with `session.representation`. Columns are "
        "named by `to(x, name)`, sources by `FROM name = source`.",
    ),
    (
        "R007", "assignment to a search variable",
        "A START WITH variable is changed in CONNECT BY only.",
        "All clauses of a step see the state before CONNECT BY. If any of them changed it, the order in which they are "
        "evaluated would decide the result.",
        "Move the assignment to CONNECT BY, or write `==` if a comparison was meant.",
    ),
    (
        "R008", "aggregate in the wrong place",
        "Aggregates work on lists, or on groups inside GROUP BY.",
        "`max(age)` in a query without GROUP BY is asked for each row, and one row has one age.",
        "Collect the values in a list, `max(SELECT age FROM people AS list)`, or add GROUP BY. "
        "`GROUP BY 1` puts all rows into one group.",
    ),
    (
        "R009", "missing parameter",
        "The compiled script has names that must be given a value when it runs.",
        "`session.compile` takes every name that it does not know as a parameter.",
        "Give the value with the run: `query.run(name=value)`. Attach sources before the script is compiled.",
    ),
    (
        "R010", "contradictory options",
        "These options of CONNECT BY do not go together.",
        "A search has one order, and one rule for rows that repeat.",
        "Keep one of the two that the message marks. `HEURISTIC` goes with `COST` or alone, `MEMORIZE` with `COST` or "
        "`PROBABILITY`, and with no other order.",
    ),
    (
        "R011", "late list outside its query",
        "A list that mentions `a.this` can only be read by a query with the source a.",
        "Such a list has another value for every row of the query that reads it, and none outside of it.",
        "Read it in FROM of a query that stands inside one with the sources it mentions.",
    ),
    (
        "R012", "incomplete search",
        "START WITH, STOP WITH, SELECT LAST and ORDER SIBLINGS BY need CONNECT BY.",
        "Without CONNECT BY nothing changes from step to step, and the query is no search.",
        "Add CONNECT BY with an assignment for each variable that changes, or with a condition that says which steps "
        "there are; or use WHERE in place of STOP WITH.",
    ),
    (
        "R013", "repeated name",
        "Two sources, clauses or variables of one query have the same name.",
        "Their columns could not be told apart.",
        "Give each its own name: `FROM a = people, b = people`.",
    ),
    (
        "R014", "misplaced construct",
        "The construct exists, but not in this place.",
        "`this` is an element of a source, `to` names a column, `*` stands for all columns: each has a meaning in a "
        "part of a query only. LIMIT, MAXIMUM and the arguments of AS are read once, before there is an element.",
        "Move it to where it belongs, or compute the value in a query first and assign it to a variable.",
    ),
    (
        "U001", "not possible in the database",
        "The engine `database` was demanded for something that only runs natively.",
        "With `engine=\"database\"` ss2sql promises that SQLite does the work, and keeps to it.",
        "Leave the engine to ss2sql, `engine=\"auto\"`, which runs such queries natively with the same result, or "
        "rewrite the query as the message says.",
    ),
    (
        "X001", "operands do not fit",
        "The operator does not work on values of these types.",
        "Text is not turned into numbers by itself, and None is no number: a guess would hide a mistake in the data.",
        "Convert one side with `int`, `float` or `str`. Ask for None first: `age != None AND age > 40`. In ORDER BY "
        "None comes first and is no error.",
    ),
    (
        "X002", "division by zero",
        "The right operand of / or % is zero.",
        "There is no such number, and None in its place would spread unnoticed.",
        "Ask first: `IF(x != 0; y / x; None)`, or leave such rows out with WHERE, in front of the division.",
    ),
    (
        "X003", "index out of range",
        "The list is shorter than the index, or the dict lacks the key.",
        "Elements are counted from 0: a list of three has 0, 1 and 2, and -1 is the last.",
        "Ask first, with `len(x)` or `key IN x`. A slice such as `x[:5]` takes what there is and never fails.",
    ),
    (
        "X004", "value not allowed",
        "NaN, infinities, complex numbers and integers beyond 64 bits are refused.",
        "NaN differs from itself, so rows with it could not be grouped, sorted or found again. SQLite holds integers "
        "of 64 bits.",
        "Let Python functions return None where there is no value. Make one operand a float where integers grow.",
    ),
    (
        "X005", "not a source",
        "FROM needs a list, a dict of columns, a table, a world or a query.",
        "A query walks the elements of its sources, and this value cannot be walked as it is.",
        "Make a list of it. Columns in a dict are lists of equal length.",
    ),
    (
        "X006", "wrong option value",
        "MAXIMUM, MEMORIZE, LIMIT, COST, HEURISTIC or PROBABILITY got a value out of range.",
        "Numbers of rows and steps are whole. The orders of COST and PROBABILITY rely on paths that never get better "
        "by getting longer.",
        "Give a number in the range that the message names. Weights become probabilities when they are divided by "
        "their sum.",
    ),
    (
        "X007", "wrong argument",
        "A built-in function got an argument that it cannot use.",
        "Built-in functions take the types of values that `help('name')` says, and do not convert others.",
        "Convert the argument, or leave such values out. A query that ends with `AS list` gives a list of values; "
        "without AS it gives a list of dicts.",
    ),
    (
        "X008", "missing column",
        "A row lacks a column that the query reads.",
        "The columns of a list of dicts are all keys of its elements, and this element has not all of them.",
        "Give every element the same keys, with None where there is no value, or read it with "
        "`IF('key' IN this; this['key']; None)`.",
    ),
    (
        "X009", "database error",
        "SQLite refused or broke off a statement.",
        "The file is locked, full, damaged or without rights, or a view reads what is gone.",
        "The message quotes SQLite. Look at the file with another program, or free what holds it.",
    ),
    (
        "X010", "row limit",
        "The query has more rows than max_rows allows.",
        "`max_rows` guards against results that nobody can read or hold, and does not cut them off unnoticed.",
        "Add LIMIT or MAXIMUM to the query, or raise `max_rows`.",
    ),
    (
        "X011", "world cannot be read",
        "A simulator refused, an element is gone, or a table breaks its declarations.",
        "Worlds are read while the query runs, from a program that has its own life.",
        "Ask for the elements anew after a body was removed. The exception of the simulator or adapter is the cause of "
        "the error, `error.__cause__`, with its traceback; `ss2sql.check_world` tries an adapter out.",
    ),
    (
        "X012", "wrong block",
        "A function that takes arrays has to return one element for each row.",
        "With `vectorized=True` a function gets the arguments of many rows at once, and its results are dealt out to "
        "them one by one.",
        "Return an array or list as long as the arguments, or register the function without `vectorized=True`.",
    ),
    (
        "X013", "worker died",
        "A process that was to call functions, as `workers` asks for, ended by itself.",
        "The function ended its process, crashed in a library, or used more memory than there is.",
        "Run once with `workers=1`, where the function runs in this process and shows what is wrong.",
    ),
    (
        "X014", "value too large",
        "The script made a text, list or dict of more bytes than `max_size` allows.",
        "Text that is added to itself forty times is longer than any memory. `l = [l, l]` needs none, but who looks "
        "at it never comes to an end.",
        "See whether the value is meant to grow like that. Keep numbers in place of long texts, or raise "
        "`connect(max_size=...)`.",
    ),
    (
        "X015", "too much output",
        "The script printed more characters than `max_output` allows.",
        "`print` in WHERE writes a line for every row that is looked at, and a search looks at many.",
        "Print where it matters, `IF(age > 100; print(name))`, or raise `connect(max_output=...)`.",
    ),
    (
        "X016", "eval inside of eval",
        "A text that `eval` runs runs another one, and so on, thirty deep.",
        "A text that runs itself never ends, and each level takes room on the stack.",
        "Let the text end, by IF or AND, or write a search: CONNECT BY repeats a step as often as it takes.",
    ),
    (
        "V001", "representation failed",
        "The rows do not fit the representation, or its arguments are wrong.",
        "A form asks something of its rows: a set needs values that can be compared, a plane needs bodies.",
        "The message says what the form asks for. Choose other columns, or another form.",
    ),
    (
        "T001", "timeout",
        "The run took longer than its timeout.",
        "It was asked for, as `timeout=` or `--timeout`. What was found is in `error.partial`.",
        "Raise the timeout, or bound the search: MAXIMUM, STOP WITH, UNIQUE or MEMORIZE with a number.",
    ),
    (
        "T002", "cancelled",
        "The run was interrupted.",
        "Somebody pressed Ctrl-C or called `session.interrupt`. What was found is in `error.partial`.",
        "The session works on: run the script again when there is time.",
    ),
    (
        "T003", "out of memory",
        "The run took more memory than it may, `max_memory`, or than there is.",
        "A search keeps the rows that it has reached, and a result all of its rows. What was found until `max_memory` "
        "is in `error.partial`.",
        "Bound the search: MAXIMUM, STOP WITH or MEMORIZE with a number; bound results with LIMIT or "
        "`max_rows`.",
    ),
    (
        "T004", "out of steps",
        "The searches of the run tried more steps than `max_steps` allows.",
        "A search whose paths go on and on never ends, and steps are counted the same on every machine, however fast "
        "it is. What was found is in `error.partial`.",
        "Bound the search: MAXIMUM, STOP WITH, UNIQUE or MEMORIZE with a number; or raise `connect(max_steps=...)`.",
    ),
    (
        "S001", "session is closed",
        "A closed session cannot run scripts.",
        "`close` or the end of `with` gave its database and its processes back.",
        "Open a new session with `ss2sql.connect()`, and run everything inside of `with`.",
    ),
    (
        "S002", "wrong registration",
        "A function, variable, table or representation cannot be registered like this.",
        "What a session is given from Python has to be something that scripts can name and use.",
        "The message says what was given and what is taken.",
    ),
    (
        "S003", "missing package",
        "It needs a package that is not installed; the error shows how to install it.",
        "Simulators, data frames and plots come with packages of their own, which ss2sql does not ask of everybody.",
        "Run the line of the message, such as `pip install pybullet`.",
    ),
    (
        "S004", "session in use",
        "The session is in use in another thread, or belongs to the process that this one is a copy of.",
        "Two scripts at once in one session would read each other's values. A file that is open in two processes by "
        "way of `fork` can be damaged.",
        "Open a session in each thread and in each process, or let threads take turns with a lock. `interrupt` and "
        "`close` may be called from any thread.",
    ),
    (
        "S005", "file is open in another SQLite",
        "The file is open in this process in another copy of SQLite, such as that of Python's `sqlite3`.",
        "The operating system keeps one set of locks per process. A copy of SQLite that unlocks or closes the file "
        "drops the locks of the other, and what that one writes then can damage the file.",
        "Close the other connection first. To read its tables while it is open, attach the connection itself: "
        "`session.attach(\"name\", connection)`. Connections of `apsw`, and of other processes, are safe.",
    ),
)  # fmt: skip
