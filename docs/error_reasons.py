"""Why each kind of error is one, and what to do about it: what the pages of errors say beside the table of codes."""

from __future__ import annotations

# By the code: why the language does not go on, and what to do.
REASONS: dict[str, tuple[str, str]] = {
    "P001": (
        "The text before the mark is valid; with the marked word it cannot become a statement. The mistake is often "
        "a little earlier: a missing comma, semicolon, operator or parenthesis.",
        "Read what the message expected at the mark. Clauses have a fixed order: SELECT, FROM, WHERE, START WITH, "
        "CONNECT BY, STOP WITH, then GROUP BY, ORDER BY and LIMIT, and AS at the end.",
    ),
    "P002": (
        "Every bracket has to be closed, and every operator and clause has to be complete.",
        "Close the bracket that the message marks, or write what is missing at the end.",
    ),
    "P003": (
        "A script is first split into words, numbers, strings and signs; this is none of them.",
        "Close strings on their own line with the quote that opened them, and comments with `*/`. Names consist of "
        "letters, digits and `_`; put any other text into quotes.",
    ),
    "P004": (
        "Such a script is nearly always data. It would take long to parse, because every number becomes a node of a "
        "tree.",
        "Pass data from Python: `session.attach(name, list)`, or a variable of `run`.",
    ),
    "P005": (
        "A script is processed by recursive functions, and the stack of a process is limited; an error is better "
        "than a crash.",
        "Assign inner parts to variables. Long sums are written `sum([...])`, long alternatives `x IN [...]`.",
    ),
    "P006": (
        "SelectScript borrows most of its words from SQL and most of its values from Python, but not every word of "
        "both: `=` assigns and `==` compares, and at the end of a query `AS` names the form of the result.",
        "Write the form that the message shows.",
    ),
    "P007": (
        "A number that no value can hold would have to be rounded silently.",
        "Write it as a float if it need not be exact, or in smaller units.",
    ),
    "P008": (
        "The value of a script is that of its last statement, so there has to be one.",
        "Write a statement. If the text came from a file or a variable, see whether it is the right one.",
    ),
    "P009": (
        "Every comma and clause belongs to the innermost open query, so its end has to be marked.",
        "Put the inner query into parentheses, or end it with `AS list` or another form.",
    ),
    "R001": (
        "Names are resolved before the first statement runs, so a typing error is found at once.",
        "Correct the spelling; names are case-sensitive. Put strings into quotes. Pass a value from Python with "
        "`run(script, name=value)`. Write a column of another source as `source.column`.",
    ),
    "R002": (
        "Scripts cannot define functions; they call Python functions that are registered with the session.",
        "Register the function with `session.function`, or on the command line with `--functions FILE.py`. `help()` "
        "lists those there are. Values have no methods: write `f(x)`, not `x.f()`.",
    ),
    "R003": (
        "A source has to exist before the query starts.",
        "Assign a list to the name, attach the data with `session.attach(name, data)`, or correct the spelling.",
    ),
    "R004": (
        "The meaning of the query would depend on the order of its sources.",
        "Write the source before the column. Name two uses of one source: `FROM a = people, b = people`.",
    ),
    "R005": (
        "Calls are checked before the script runs, from the signature of the function.",
        "`help('name')` shows the arguments. Those of IF are separated by semicolons.",
    ),
    "R006": (
        "AS at the end of a query names the form of its rows. In SELECT, AS names a column.",
        "Choose one of the forms that the message lists, or register one with `session.representation`. Columns are "
        "named by `to(x, name)`, sources by `FROM name = source`.",
    ),
    "R007": (
        "All clauses of a step see the state before CONNECT BY. If any of them changed it, the order in which they "
        "are evaluated would decide the result.",
        "Move the assignment to CONNECT BY, or write `==` if a comparison was meant.",
    ),
    "R008": (
        "`max(age)` in a query without GROUP BY is evaluated for each row, and one row has one age.",
        "Collect the values in a list, `max(SELECT age FROM people AS list)`, or add GROUP BY. `GROUP BY 1` puts all "
        "rows into one group.",
    ),
    "R009": (
        "`session.compile` takes every name that it does not know as a parameter.",
        "Pass the value to the run: `query.run(name=value)`. Attach sources before the script is compiled.",
    ),
    "R010": (
        "A search has one order, and one rule for repeated rows.",
        "Keep one of the two that the message marks. `HEURISTIC` goes with `COST` or alone, `MEMORIZE` with `COST` "
        "or `PROBABILITY`, and with no other order.",
    ),
    "R011": (
        "Such a list has another value for every row of the query that reads it, and none outside of it.",
        "Read it in FROM of a query that stands inside one with the sources it mentions.",
    ),
    "R012": (
        "Without CONNECT BY nothing changes from step to step, and the query is no search.",
        "Add CONNECT BY with an assignment for each variable that changes, or with a condition that says which steps "
        "there are; or use WHERE in place of STOP WITH.",
    ),
    "R013": (
        "Their columns could not be told apart.",
        "Give each its own name: `FROM a = people, b = people`.",
    ),
    "R014": (
        "`this` is an element of a source, `to` names a column, `*` stands for all columns: each has a meaning in a "
        "part of a query only. LIMIT, MAXIMUM and the arguments of AS are read once, before there is an element.",
        "Move it to where it belongs, or compute the value in a query first and assign it to a variable.",
    ),
    "U001": (
        '`engine="database"` guarantees that SQLite runs the query; SQLite cannot run this one. DuckDB likewise.',
        'Leave the engine to ss2sql, `engine="auto"`, or ask for `engine="native"`, which runs such queries with '
        "the same result, or rewrite the query as the message says.",
    ),
    "X001": (
        "Strings are not converted to numbers implicitly, and None is not a number: a conversion would hide errors "
        "in the data.",
        "Convert one side with `int`, `float` or `str`. Test for None first: `age != None AND age > 40`. In ORDER BY "
        "None comes first and is no error.",
    ),
    "X002": (
        "The result is undefined, and None in its place would propagate unnoticed.",
        "Test first: `IF(x != 0; y / x; None)`, or exclude such rows in WHERE, before the division.",
    ),
    "X003": (
        "Elements are counted from 0: a list of three has 0, 1 and 2, and -1 is the last.",
        "Test first, with `len(x)` or `key IN x`. A slice such as `x[:5]` never fails: it returns the elements that "
        "exist.",
    ),
    "X004": (
        "NaN differs from itself, so rows with it could not be grouped, sorted or found again. SQLite holds integers "
        "of 64 bits.",
        "Let Python functions return None for a missing value. Make one operand a float if integers grow large.",
    ),
    "X005": (
        "A query iterates over the elements of its sources, and this value has no elements.",
        "Convert it to a list. Columns in a dict have to be lists of equal length.",
    ),
    "X006": (
        "Numbers of rows and steps are whole. The orders of COST and PROBABILITY rely on paths that never get better "
        "by getting longer.",
        "Give a number in the range that the message names. Weights become probabilities when they are divided by "
        "their sum.",
    ),
    "X007": (
        "Built-in functions take the types of values that `help('name')` says, and do not convert others.",
        "Convert the argument, or leave such values out. A query that ends with `AS list` gives a list of values; "
        "without AS it gives a list of dicts.",
    ),
    "X008": (
        "The columns of a list of dicts are all keys of its elements, and this element has not all of them.",
        "Give every element the same keys, with None where there is no value, or read it with `IF('key' IN this; "
        "this['key']; None)`.",
    ),
    "X009": (
        "The file is locked, full, damaged or without rights, or a view reads what is gone.",
        "The message quotes SQLite. Look at the file with another program, or free what holds it.",
    ),
    "X010": (
        "`max_rows` guards against results that nobody can read or hold, and does not cut them off unnoticed.",
        "Add LIMIT or MAXIMUM to the query, or raise `max_rows`.",
    ),
    "X011": (
        "Worlds are read while the query runs, from another program that may change meanwhile.",
        "Query the elements again after a body was removed. The exception of the simulator or adapter is the cause "
        "of the error, `error.__cause__`, with its traceback; `ss2sql.check_world` tries an adapter out.",
    ),
    "X012": (
        "With `vectorized=True` a function gets the arguments of many rows at once, and its results are dealt out to "
        "them one by one.",
        "Return an array or list as long as the arguments, or register the function without `vectorized=True`.",
    ),
    "X013": (
        "The function ended its process, crashed in a library, or used more memory than there is.",
        "Run once with `workers=1`, where the function runs in this process and shows what is wrong.",
    ),
    "X014": (
        "A string that is doubled forty times exceeds any memory. `l = [l, l]` takes little memory, but printing or "
        "comparing it never ends.",
        "Check whether the value should grow like that. Keep numbers in place of long texts, or raise "
        "`connect(max_size=...)`.",
    ),
    "X015": (
        "`print` in WHERE writes a line for every row that is evaluated, and a search evaluates many.",
        "Print only selected rows, `IF(age > 100; print(name))`, or raise `connect(max_output=...)`.",
    ),
    "X016": (
        "A script that runs itself never ends, and each level takes room on the stack.",
        "End the recursion with IF or AND, or write a search: CONNECT BY repeats a step as often as needed.",
    ),
    "V001": (
        "A representation has requirements: a set needs values that can be compared, a plane needs bodies.",
        "The message states the requirement. Choose other columns, or another representation.",
    ),
    "T001": (
        "The limit was set by `timeout=` or `--timeout`. The results found so far are in `error.partial`.",
        "Raise the timeout, or bound the search: MAXIMUM, STOP WITH, UNIQUE or MEMORIZE with a number.",
    ),
    "T002": (
        "Ctrl-C was pressed, or `session.interrupt` called. The results found so far are in `error.partial`.",
        "The session can still be used: run the script again.",
    ),
    "T003": (
        "A search keeps the rows that it has visited, and a result all of its rows. The results found before "
        "`max_memory` was exceeded are in `error.partial`.",
        "Bound the search: MAXIMUM, STOP WITH or MEMORIZE with a number; bound results with LIMIT or `max_rows`.",
    ),
    "T004": (
        "The limit stops searches that might not terminate. The number of steps is the same on every machine. The "
        "results found so far are in `error.partial`.",
        "Bound the search: MAXIMUM, STOP WITH, UNIQUE or MEMORIZE with a number; or raise `connect(max_steps=...)`.",
    ),
    "S001": (
        "`close` or the end of `with` released its database and its processes.",
        "Open a new session with `ss2sql.connect()`, and run everything inside of `with`.",
    ),
    "S002": (
        "Scripts have to be able to name and use what is registered with a session.",
        "The message says what was passed and what is accepted.",
    ),
    "S003": (
        "Simulators, data frames and plots need packages that are optional: `docs/install.md` lists them.",
        "Run the line of the message, such as `pip install pybullet`.",
    ),
    "S004": (
        "Two scripts at once in one session would read each other's values. A file that is open in two processes by "
        "way of `fork` can be damaged.",
        "Open a session in each thread and in each process, or let threads take turns with a lock. `interrupt` and "
        "`close` may be called from any thread.",
    ),
    "S005": (
        "The operating system keeps one set of locks per process. A copy of SQLite that unlocks or closes the file "
        "drops the locks of the other, and what that one writes then can damage the file.",
        "Close the other connection first. To read its tables while it is open, attach the connection itself: "
        '`session.attach("name", connection)`. Connections of `apsw`, and of other processes, are safe.',
    ),
}
