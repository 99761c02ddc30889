"""What the parser says about text that is not SelectScript: code, place, reason and cure, by the error's text."""

from __future__ import annotations

import pytest
from trees import check, failure

MISSING = [
    ("SELECT a FROM b WHERE «;»", "P001", "expected a condition after WHERE, found ';'", ""),
    ("SELECT a FROM b WHERE«»", "P002", "expected a condition after WHERE, found the end of the script", ""),
    ("SELECT a FROM b WHERE «AND» c", "P001", "expected a condition after WHERE, found AND", ""),
    ("SELECT a FROM b WHERE c AND «STOP» WITH d", "P001", "expected a value after AND, found STOP WITH", ""),
    ("SELECT a FROM«»", "P002", "expected a source after FROM", ""),
    ("SELECT a FROM «WHERE» c", "P001", "expected a source after FROM, found WHERE", ""),
    ("SELECT a FROM «FROM» c", "P001", "expected a source after FROM, found FROM", ""),
    ("SELECT «FROM» b", "P001", "expected a column after SELECT, found FROM", ""),
    ("SELECT«»", "P002", "expected a column after SELECT", ""),
    ("SELECT a, «FROM» b", "P001", "expected a column after ',', found FROM", "leave the comma out"),
    ("SELECT a FROM b, «WHERE» c", "P001", "expected a source after ',', found WHERE", "leave the comma out"),
    ("SELECT a FROM b, «START» WITH x = 1", "P001", "expected a source after ',', found START WITH", "leave the comma"),
    ("SELECT a FROM b GROUP BY«»", "P002", "expected a value to group by after GROUP BY", ""),
    ("SELECT a FROM b ORDER BY«»", "P002", "expected a value to sort by after ORDER BY", ""),
    ("SELECT a FROM b LIMIT«»", "P002", "expected a number after LIMIT", ""),
    ("SELECT a FROM b AS «;»", "P001", "expected a representation such as list or value after AS, found ';'", ""),
    ("SELECT a FROM b START WITH«»", "P002", "expected an assignment such as level = 1 after START WITH", ""),
    ("SELECT a FROM b START WITH «CONNECT» BY x = 1", "P001", "expected an assignment such as level = 1", ""),
    ("SELECT a FROM b START WITH x = 1, «CONNECT» BY x = 1", "P001", "found CONNECT BY", "leave the comma out"),
    ("SELECT a FROM b START WITH x = «CONNECT» BY x = 1", "P001", "expected a value after '=', found CONNECT BY", ""),
    ("SELECT a FROM b START WITH x «==» 1", "P001", "expected '=' after 'x', found '=='", "WITH x = ..."),
    (
        "SELECT a FROM b START WITH x = 1 CONNECT BY UNIQUE«»",
        "P002",
        "expected an assignment",
        "NO CYCLE level = level",
    ),
    ("SELECT a FROM b CONNECT BY MEMORIZE «1.5» x = 2", "P001", "MEMORIZE takes a whole number, not '1.5'", "(n)"),
    ("«SELECT a FROM b» IN [1, 2]", "P009", "to the left of IN is not ended", "to name a source write FROM b = ..."),
    ("let «FROM»", "P001", "FROM does not fit here", "the order of a query is SELECT, FROM"),
    ("[1] «=» 5", "P001", "only a name can be assigned here, not [1]", "write [1] == 5 to compare"),
    ("SELECT a FROM b CONNECT BY «;»", "P001", "expected an assignment such as level = level + 1", ""),
    ("SELECT a FROM b CONNECT BY UNIQUE «STOP» WITH c", "P001", "after UNIQUE, found STOP WITH", ""),
    ("SELECT a FROM b CONNECT BY UNIQUE«,» x = 1", "P001", "options stand without commas", "leave the comma out"),
    ("SELECT a FROM b CONNECT BY x = 1 «UNIQUE»", "P001", "UNIQUE stands behind an assignment", "right behind CONNECT"),
    ("SELECT a FROM b CONNECT BY x = 1, «NO» CYCLE", "P001", "NO stands behind an assignment", "right behind CONNECT"),
    ("SELECT a FROM b CONNECT BY MAXIMUM «n» x = 1", "P001", "a whole number or a value in parentheses", ""),
    ("SELECT a FROM b CONNECT BY MAXIMUM «-» 1 x = 1", "P001", "a whole number or a value in parentheses", ""),
    ("SELECT a FROM b CONNECT BY MEMORIZE n «x» = 1", "P001", "expected '=' after 'n'", "MEMORIZE (n)"),
    ("SELECT a FROM b CONNECT BY COST x «=» 1", "P001", "COST needs a value", "write COST 1 x = ..."),
    ("SELECT a«;»", "P001", "expected FROM after the columns, found ';'", "SELECT ... FROM source"),
    ("SELECT a, b «WHERE» c", "P001", "expected FROM after the columns, found WHERE", "SELECT ... FROM source"),
    ("SELECT *«»", "P002", "expected FROM after *", "SELECT ... FROM source"),
    ("f(1, «)»", "P001", "expected an argument after ',', found ')'", "leave the comma out"),
    ("[1, 2, «]»", "P001", "expected a value after ',', found ']'", "leave the comma out"),
    ("x[«]»", "P001", "expected an index after '[', found ']'", ""),
    ("IF(«;» a)", "P001", "expected a condition after '(', found ';'", ""),
    ("IF «a»; b", "P001", "expected '(' after IF, found 'a'", "IF(condition; then; else)"),
    ("a NOT «b»", "P001", "expected IN after NOT, found 'b'", ""),
    ("a.«;»", "P001", "expected this or a column after '.', found ';'", ""),
    ("3 +«»", "P002", "expected a value after '+', found the end of the script", ""),
    ("«+»5", "P001", "expected a value, found '+'", "leave the + out"),
    ("«*»", "P001", "expected a value, found '*'", ""),
]


@pytest.mark.parametrize(("marked", "code", "message", "hint"), MISSING)
def test_what_is_missing(marked: str, code: str, message: str, hint: str) -> None:
    check(marked, code, message, hint)


PAIRS = [
    ("SELECT a FROM b STOP «level» == 7", "expected WITH after STOP, found 'level'", "STOP WITH"),
    ("SELECT a FROM b START «x» = 7", "expected WITH after START, found 'x'", "START WITH"),
    ("SELECT a FROM b CONNECT «x» = 7", "expected BY after CONNECT, found 'x'", "CONNECT BY"),
    ("SELECT a FROM b GROUP «a»", "expected BY after GROUP, found 'a'", "GROUP BY"),
    ("SELECT a FROM b ORDER «a»", "expected BY after ORDER, found 'a'", "ORDER BY"),
    ("SELECT a FROM b CONNECT BY DEPTH «x» = 1", "expected FIRST after DEPTH, found 'x'", "DEPTH FIRST"),
    ("SELECT a FROM b CONNECT BY BREADTH «x» = 1", "expected FIRST after BREADTH, found 'x'", "BREADTH FIRST"),
    ("SELECT a FROM b CONNECT BY NO «x» = 1", "expected CYCLE after NO, found 'x'", "NO CYCLE"),
    ("SELECT a FROM b «WITH» x = 1", "WITH does not fit here", "START WITH or STOP WITH"),
    ("SELECT a FROM b «BY» a", "BY does not fit here", "CONNECT BY, GROUP BY or ORDER BY"),
]


@pytest.mark.parametrize(("marked", "message", "hint"), PAIRS)
def test_keywords_of_two_words(marked: str, message: str, hint: str) -> None:
    check(marked, "P001", message, hint)


MISSPELT = [
    ("«SELCT» a FROM b", "SELECT"),
    ("x = max(«SELCET» a FROM b)", "SELECT"),
    ("SELECT a «FORM» b", "FROM"),
    ("SELECT a, c «FRMO» b", "FROM"),
    ("SELECT a FROM b «WHER» c", "WHERE"),
    ("SELECT a FROM b WHERE c «ADN» d", "AND"),
    ("SELECT a FROM b «STRAT» WITH x = 1", "START WITH"),
    ("SELECT a FROM b «CONECT» BY x = 1", "CONNECT BY"),
    ("SELECT a FROM b WHERE c «STPO» WITH x", "STOP WITH"),
    ("SELECT a FROM b «GRUOP» BY c", "GROUP BY"),
    ("SELECT a FROM b «GROUPBY» c", "GROUP BY"),
    ("SELECT a FROM b GROUP BY c «HAVNIG» d", "HAVING"),
    ("SELECT a FROM b «ODER» BY c", "ORDER BY"),
    ("SELECT a FROM b ORDER BY c «DESCENDING»", "DESC"),
    ("SELECT a FROM b ORDER BY c «ACS»", "ASC"),
    ("SELECT a FROM b «LIMTI» 3", "LIMIT"),
    ("SELECT a FROM b CONNECT BY «UNIQE» x = 1", "UNIQUE"),
    ("SELECT a FROM b CONNECT BY «NOCYCLE» x = 1", "NO CYCLE"),
    ("SELECT a FROM b CONNECT BY «DEPTHFIRST» x = 1", "DEPTH FIRST"),
    ("SELECT a FROM b CONNECT BY «MEMOIZE» 5 x = 1", "MEMORIZE"),
]


@pytest.mark.parametrize(("marked", "keyword"), MISSPELT)
def test_misspelt_keywords(marked: str, keyword: str) -> None:
    check(marked, "P001", "is not a keyword", f"did you mean {keyword}?")


ORDER = "the order is SELECT, FROM, WHERE, START WITH, CONNECT BY, STOP WITH"
CLAUSES = [
    ("SELECT a FROM b START WITH x = 1 «WHERE» c", "WHERE stands before START WITH", ORDER),
    ("SELECT a FROM b CONNECT BY x = 1 «START» WITH x = 1", "START WITH stands before CONNECT BY", ORDER),
    ("SELECT a FROM b STOP WITH c «CONNECT» BY x = 1 WHERE d", "CONNECT BY stands before STOP WITH", ORDER),
    ("SELECT a FROM b LIMIT 1 «WHERE» c", "WHERE stands before LIMIT", ORDER),
    ("SELECT a FROM b ORDER BY c «STOP» WITH c", "STOP WITH stands before ORDER BY", ORDER),
    ("SELECT a FROM b WHERE c «WHERE» d", "WHERE stands twice", "join the conditions with AND"),
    ("SELECT a FROM b STOP WITH c «STOP» WITH d", "STOP WITH stands twice", "join the conditions with OR"),
    ("SELECT a FROM b GROUP BY c LIMIT 1 «GROUP» BY d", "GROUP BY stands twice", "write one list"),
    ("SELECT a FROM b ORDER BY c «ORDER» BY d", "ORDER BY stands twice", "write one list"),
    ("SELECT a FROM b LIMIT 1 «LIMIT» 2", "LIMIT stands twice", "keep one"),
    ("SELECT a FROM b «HAVING» c", "HAVING stands right behind GROUP BY", "or use WHERE"),
    ("SELECT a FROM b GROUP BY c LIMIT 1 «HAVING» c", "HAVING stands right behind GROUP BY", "or use WHERE"),
    ("«WHERE» x == 1", "a query starts with SELECT, not with WHERE", "the order is SELECT, FROM"),
    ("a «WHERE» b", "WHERE does not fit here", "the order of a query is SELECT, FROM"),
    ("SELECT a FROM b AS plane(x = 3, «5»)", "has no name", "positional arguments come first"),
]


@pytest.mark.parametrize(("marked", "message", "hint"), CLAUSES)
def test_clauses_in_the_wrong_place(marked: str, message: str, hint: str) -> None:
    check(marked, "P001", message, hint)


AS_OR_PARENTHESES = "end it with AS, for instance AS list, or put it in parentheses"
UNENDED = [
    ("SELECT a FROM «SELECT b FROM c»", "not ended", AS_OR_PARENTHESES),
    ("SELECT a FROM «SELECT b FROM c WHERE d»;", "not ended", AS_OR_PARENTHESES),
    ("SELECT a FROM n = «SELECT b FROM c»", "not ended", AS_OR_PARENTHESES),
    ("SELECT a FROM b WHERE c == «SELECT d FROM e»", "not ended", AS_OR_PARENTHESES),
    ("SELECT a FROM b WHERE NOT c IN «SELECT d FROM e»", "not ended", AS_OR_PARENTHESES),
    ("SELECT «SELECT a FROM b» FROM c", "not ended", AS_OR_PARENTHESES),
    ("SELECT a FROM b START WITH x = «SELECT c FROM d, y = 1»", "not ended", AS_OR_PARENTHESES),
    ("SELECT a FROM b CONNECT BY x = «SELECT c FROM d»", "not ended", AS_OR_PARENTHESES),
    ("SELECT a FROM b CONNECT BY COST «SELECT c FROM d» x = 1", "not ended", AS_OR_PARENTHESES),
    ("SELECT a FROM b STOP WITH «SELECT c FROM d»", "not ended", AS_OR_PARENTHESES),
    ("SELECT a FROM b GROUP BY «SELECT c FROM d»", "not ended", AS_OR_PARENTHESES),
    ("SELECT a FROM b GROUP BY a HAVING «SELECT c FROM d»", "not ended", AS_OR_PARENTHESES),
    ("SELECT a FROM b ORDER BY «SELECT c FROM d»", "not ended", AS_OR_PARENTHESES),
    ("SELECT a FROM b LIMIT «SELECT c FROM d»", "not ended", AS_OR_PARENTHESES),
    ("max(«SELECT a FROM b» + 1)", "to the left of + is not ended", "FROM (a + b)"),
    ("«SELECT a FROM b» AND c", "to the left of AND is not ended", AS_OR_PARENTHESES),
    ("«SELECT a FROM b» + 1 WHERE c", "to the left of + is not ended", "FROM (a + b)"),
    ("«SELECT a FROM b AS list» == []", "to the left of == stands in parentheses", "(SELECT ... AS list) == ..."),
    ("c + «SELECT a FROM b AS value» < d", "to the left of < stands", "(SELECT ... AS value) < ..."),
    ("«SELECT a FROM b AS list» NOT IN c", "to the left of NOT IN", "(SELECT ... AS list) NOT IN ..."),
    ("SELECT a FROM b AS list«[»0]", "to the left of '[' stands in parentheses", "(SELECT ... AS list)[ ..."),
    ("SELECT a FROM b AS value «^» 2", "to the left of '^' stands in parentheses", "(SELECT ... AS value)^ ..."),
]


@pytest.mark.parametrize(("marked", "message", "hint"), UNENDED)
def test_queries_that_nothing_ends(marked: str, message: str, hint: str) -> None:
    check(marked, "P009", message, hint)


WRONG = [
    ("a < b «<» c", "a comparison does not go on with '<'", "a < b AND b < c"),
    ("a == b «IN» c", "a comparison does not go on with IN", "a < b AND b < c"),
    ("SELECT a FROM b WHERE 1 < a «<» 3", "a comparison does not go on with <", "a < b AND b < c"),
    ("SELECT a FROM b WHERE c OR 1 IN a «NOT IN» d", "a comparison does not go on with NOT IN", "a < b AND b < c"),
    ("f(x) «=» 3", "only a name can be assigned here, not f(x)", "write f(x) == 3"),
    ("n.a «=» 3", "only a name can be assigned here, not n.a", "write n.a == 3"),
    ("x.y «=» 1", "only a name can be assigned here, not x.y", "write x.y == 1"),
    ("«FROM» a SELECT b", "a query starts with SELECT, not with FROM", "SELECT ... FROM"),
    ("SELECT a «b»", "expected FROM between 'a' and 'b'", "write FROM b"),
    ("SELECT a «b» WHERE c", "expected FROM between 'a' and 'b'", "write FROM b"),
    ("SELECT 1 + 1«;»", "expected FROM after the columns", "a value alone needs no SELECT: write 1 + 1"),
    ("x = 'it'«s» + 1", "the string 'it' ends at its second '", 'the string stands in "'),
    ("3 «=» x", "only a name can be assigned here, not 3", "write 3 == x"),
    ("«from» = 3", "FROM is a reserved word, not a name", "choose another name"),
    ("«this» = 3", "THIS is a reserved word, not a name", "choose another name"),
    ("x = n.«from»", "FROM is a reserved word, not a name", 'write n["from"]'),
    ("SELECT a FROM b AS «in»", "IN is a reserved word, not a name", "choose another name"),
    ("a.b«.»c", "a dot stands behind the name of a source only, not behind a.b", 'write a.b["c"]'),
    ("f(x)«.»y", "a dot stands behind the name of a source only, not behind f(x)", 'write f(x)["y"]'),
    ("x = «{»'a': 1}", "a dict cannot be written", "from Python"),
    ("«v{}» = 3", "does not say how many seconds to keep", "v{5.0} ="),
    ("IF(a; b; c«;» d)", "';' does not fit here in IF", "IF(a; b, c; d)"),
    ("IF(a«,» b)", "',' does not fit here in IF", "IF(a; b, c; d)"),
    ("x = a «if» b else c", "expected an operator or ';' between 'a' and IF", "IF(condition; then; else)"),
    ("a = 3\n«b» = 4", "expected an operator or ';' between '3' and 'b'", "statements are separated by ;"),
    ("print «'x'»", "expected an operator or ';' between 'print' and 'x'", "print('x')"),
    ("SELECT a FROM b ORDER BY «DESC» c", "DESC stands behind the value", "write c DESC"),
    ("SELECT a FROM b WHERE c «NOT» = 3", "NOT does not go with =", "write c != ..."),
    ("SELECT a FROM b WHERE c «NOT» == 3", "NOT does not go with ==", "write c != ..."),
    ("SELECT a FROM b WHERE c IN 'x'«,» 'y'", "between 'x' and ','", "a list stands in square brackets"),
    ("x = [1 «2»]", "between '1' and '2'", "the elements of a list are separated by commas"),
    ("x = [1«;» 2]", "expected ']' before ';'", "the elements of a list are separated by commas"),
    ("x = [1«:»2]", "between '1' and ':'", "range(from, to)"),
    ("if (a > b) «{» c }", "between ')' and '{'", "IF(condition; then; else)"),
    ("SELECT a FROM b START WITH n = 1 CONNECT BY «MAX» 3 n = 2", "'MAX' is not a keyword", "MAXIMUM"),
    ("len «x»", "expected an operator or ';' between 'len' and 'x'", "len(x)"),
    ("x = y\n«z»", "expected an operator or ';' between 'y' and 'z'", "statements are separated by ;"),
    ("SELECT a FROM b «t» WHERE c", "expected ',', a clause or ';' between 'b' and 't'", "write t = b"),
    ("SELECT a FROM f(b) «1»", "expected ',', a clause or ';' between ')' and '1'", "stands in parentheses"),
    ("SELECT a FROM b WHERE c «d»", "expected an operator, a clause or ';' between 'c' and 'd'", ""),
    ("SELECT a FROM b ORDER BY c DESC «d»", "between DESC and 'd'", ""),
    ("SELECT a FROM b «where» = 3", "expected ',', a clause or ';' between 'b' and 'where'", "write where = b"),
    ("«)»", "')' closes nothing", "open it with '('"),
    ("x = 3«]»", "']' closes nothing", "open it with '['"),
]


@pytest.mark.parametrize(("marked", "message", "hint"), WRONG)
def test_what_does_not_fit(marked: str, message: str, hint: str) -> None:
    check(marked, "P001", message, hint)


# The bracket that is open is marked by `‹›`.
BRACKETS = [
    ("x = ‹(›1 + 2«;»", "P001", "expected ')' before ';'", "write the missing ')'"),
    ("x = max‹(›SELECT a FROM b AS list«;»", "P001", "expected ')' before ';'", "write the missing ')'"),
    ("x = ‹[›1, f(2)«;»", "P001", "expected ']' before ';'", "write the missing ']'"),
    ("x = f‹(›1, [2]«»", "P002", "the script ends before '(' is closed", "write the missing ')'"),
    ("SELECT a FROM b WHERE ‹(›f(c) AND d«»", "P002", "the script ends before '(' is closed", "write the missing ')'"),
    ("SELECT f‹(›a «FROM» b", "P001", "expected ')' before FROM", "write the missing ')'"),
    ("SELECT a FROM f‹(›b «WHERE» c", "P001", "expected ')' before WHERE", "write the missing ')'"),
    ("f‹(›«»", "P002", "expected an argument after '(', found the end of the script", ""),
    ("f‹(›a, «;»", "P001", "expected an argument after ',', found ';'", "leave the comma out"),
    ("x = ‹[›1, 2«)»", "P001", "expected ']', found ')'", "'[' needs ']'"),
    ("f‹(›a[1] «b»)", "P001", "expected an operator, ',' or ')' between ']' and 'b'", ""),
    ("‹[›a «b»]", "P001", "expected an operator, ',' or ']' between 'a' and 'b'", ""),
    ("v‹{›1 «2»}", "P001", "expected an operator or '}' between '1' and '2'", ""),
    ("x = ‹[›1, 2\n«y» = 3", "P001", "expected an operator, ',' or ']' between '2' and 'y'", ""),
]


@pytest.mark.parametrize(("marked", "code", "message", "hint"), BRACKETS)
def test_errors_in_brackets_say_where_they_were_opened(marked: str, code: str, message: str, hint: str) -> None:
    check(marked.replace("‹", "").replace("›", ""), code, message, hint)
    plain = marked.replace("«", "").replace("»", "")
    ((place, label),) = failure(plain.replace("‹", "").replace("›", "")).related
    assert (place.start, label) == (plain.index("‹"), "opened here")


UNREADABLE = [
    ('x = «"abc»', "P003", "this string is not closed", 'write " at its end'),
    ("x = «'abc;»\n", "P003", "this string is not closed", "write ' at its end"),
    ("x = a «?» b : c", "P003", "no character '?'", "IF(condition; then; else)"),
    ("x = 'a' «/*» comment", "P003", "this comment is not closed", "write */"),
    ("x = 3 «$» 4", "P003", "the language has no character '$'", "parameter"),
    ("«@»x", "P003", "the language has no character '@'", "parameter"),
    ("x = «`»a`", "P003", "the language has no character '`'", 'x["key"]'),
    ("x «→» y", "P003", "'→' (U+2192 RIGHTWARDS ARROW)", ""),
    ("x = größe«²»", "P003", "'²' (U+00B2 SUPERSCRIPT TWO)", ""),
    ("«“»abc”", "P003", "LEFT DOUBLE QUOTATION MARK", "strings stand in"),
    ("3«≤»b", "P003", "LESS-THAN OR EQUAL TO", "write <="),
    ("a «≤» b", "P003", "LESS-THAN OR EQUAL TO", "write <="),
    ("a \\«» b".replace("\\«»", "«\\»"), "P003", "the language has no character '\\'", "next line"),
    ("a «\x01» b", "P003", "U+0001", ""),
    ("a\u200b b".replace("\u200b", "«\u200b»"), "P003", "U+200B ZERO WIDTH SPACE", ""),
    ("«3x»", "P003", "'3x' is neither a number nor a name", "without units"),
    ("x = «1_000»", "P003", "'1_000' is neither a number nor a name", "without units"),
    ("«0x1F»", "P003", "'0x1F' is neither a number nor a name", "without units"),
    ("x = '«\\x»4'", "P003", "this escape is not complete: \\x", "\\x41"),
    ("x = '«\\u»00g0'", "P003", "this escape is not complete: \\u", "\\u0041"),
    ("x = '«\\N{NO SUCH NAME}»'", "P003", "no character named 'NO SUCH NAME'", ""),
    ("x = 'a«\\ud800»'", "P003", "\\ud800 is not a character", "U0010ffff"),
    ("x = '«\\U00110000»'", "P003", "\\U00110000 is not a character", "U0010ffff"),
    ("a = «9223372036854775808» + 1", "P007", "beyond 64 bits", "1e30 is a float"),
    ("a = -(«9223372036854775808»)", "P007", "beyond 64 bits", "1e30 is a float"),
    ("a = -«9223372036854775808»[0]", "P007", "beyond 64 bits", "1e30 is a float"),
    ("a = -«9223372036854775808» ^ 2", "P007", "beyond 64 bits", "1e30 is a float"),
    ("a = -«9223372036854775809»", "P007", "beyond 64 bits", "1e30 is a float"),
    ("a = «1e999»", "P007", "too large for a float", "1.8e308"),
    ("«a\0b»".replace("«a\0b»", "a«\0»b"), "P003", "contains a NUL character", "binary"),
    ("a = '«\ud800»'", "P003", "half of a character, U+D800", "Unicode"),
    ("«»", "P008", "no statement", "SELECT this FROM"),
    ("«» ; # nothing\n ;; /* at all */", "P008", "no statement", "SELECT this FROM"),
]


@pytest.mark.parametrize(("marked", "code", "message", "hint"), UNREADABLE)
def test_text_that_cannot_be_read(marked: str, code: str, message: str, hint: str) -> None:
    check(marked, code, message, hint)


# Several errors at once


def places(source: str) -> list[tuple[str, str]]:
    """Code and line:column of every error."""
    return [(error.code, error.span.place.split(":", 1)[1]) for error in failure(source).errors if error.span]


def test_each_statement_has_its_error() -> None:
    assert places("x = ;\ny = 3 +;\nz = 4;\nSELECT a FORM b;\nw = (1") == [
        ("P001", "1:5"),
        ("P001", "2:8"),
        ("P001", "4:10"),
        ("P002", "5:7"),
    ]
    assert places("x = 'abc;\ny = 3 3;\nz = 1 $ 2 $ 3; u = -'\\x';") == [
        ("P003", "1:5"),
        ("P001", "2:7"),
        ("P003", "3:7"),
        ("P003", "3:22"),
    ]


def test_errors_inside_a_statement_do_not_multiply() -> None:
    for source in (
        "IF(a b; c d; e f)",
        "f(IF(a; b; c; d), IF(a; b; c; d))",
        "SELECT a b c FROM d e WHERE f = g AND h = IF(i = j; k; l)",
        "x = [1, 2 3, f(4 5; 6)]",
        "SELECT a FROM b STOP WITH c START WITH d = 1 WHERE e",
    ):
        assert len(places(source)) == 1
        assert places(f"{source}; y = = 2") == [*places(source), ("P001", f"1:{len(source) + 7}")]


def test_an_open_bracket_ends_with_its_statement() -> None:
    assert places("x = (1 + 2;\ny = 3 3;") == [("P001", "1:11"), ("P001", "2:7")]
    assert places("x = f(1, [2;\nIF(a; b; c);\ny = 3 3;") == [("P001", "1:12"), ("P001", "3:7")]


def test_at_most_ten_errors_are_told() -> None:
    error = failure("x = ;\n" * 50)
    assert len(error.errors) == 10
    assert error.errors[0] is error
    assert str(error).count("error[P001]") == 10
    assert places("9223372036854775808;" * 50) == [("P007", f"1:{20 * number + 1}") for number in range(10)]


def test_errors_come_in_the_order_of_the_text() -> None:
    found = places("x = 1e999; y = ; z = SELECT a FROM SELECT b FROM c; w = 1 2;")
    assert [code for code, _ in found] == ["P007", "P001", "P009", "P001"]


def test_a_rendered_error_shows_place_reason_and_cure() -> None:
    rendered = str(failure("SELECT a FROM b\nSTOP level == 7;"))
    assert "error[P001]: expected WITH after STOP, found 'level'" in rendered
    assert "<script>:2:6" in rendered
    assert "2 | STOP level == 7;" in rendered
    assert "^^^^^" in rendered
    assert "= help: the keyword is STOP WITH" in rendered
