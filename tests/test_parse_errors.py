"""What the parser says about text that is not SelectScript, or is that of another language: code, place, reason, cure.

Golden cases (`cases/errors`) show the most frequent errors as a user sees them; the table has all others.
"""

from __future__ import annotations

import re

import pytest
from trees import check, failure

ORDER = "the order is SELECT, FROM, WHERE, START WITH, CONNECT BY, STOP WITH"
WHOLE_ORDER = "the order of a query is SELECT, FROM"
COMMA = "leave the comma out"
UNENDED = "this query inside another is not ended"
AS_OR_PARENTHESES = "end it with AS, for instance AS list, or put it in parentheses"
JOIN = "FROM a, b WHERE a.id == b.id"
LISTS = "the elements of a list are separated by commas"
STEP = "expected an assignment such as level = 1"

# Words and operators of other languages, where they stand, with words of the hint.
FOREIGN = {
    "SELECT a FROM b WHERE a «LIKE» '%xy'": "write a[-2:] == 'xy'",
    "SELECT a FROM b WHERE a «LIKE» '%xy%'": "write 'xy' IN a",
    "SELECT a FROM b WHERE a «LIKE» 'xy'": "write a == 'xy'", "SELECT a FROM b WHERE a «ILIKE» 'x%'": "'part' IN a",
    "SELECT a FROM b WHERE a «CONTAINS» 'x'": "'part' IN a",
    "SELECT a FROM b WHERE a «STARTS» WITH 'x'": "a[:n] == 'part'",
    "SELECT a FROM b WHERE «EXISTS» SELECT c FROM d": "[] != (SELECT ... AS list)",
    "SELECT «DISTINCT» x, y FROM b WHERE x; 1": "uniq(SELECT x, y FROM b WHERE x AS rows)",
    "len(SELECT «DISTINCT» x FROM b AS list)": "uniq(SELECT x FROM b AS list)",
    "SELECT «ALL» x FROM b": "gives all rows", "SELECT «TOP» 5 x FROM b": "LIMIT n",
    "SELECT a FROM b «TOP» 3": "LIMIT n", "SELECT a «INTO» c FROM b": "name = SELECT",
    "SELECT a FROM b AS list «UNION» SELECT c FROM d": "(SELECT ... AS list) + (SELECT",
    "SELECT a FROM b START WITH n = 1 CONNECT BY n = 2 «UNTIL» n == 2": "STOP WITH condition",
    "SELECT a FROM b WHERE a «&&» b": "AND", "SELECT a FROM b WHERE «!»a": "NOT", "7 «MOD» 2": "write 7 % ...",
    "«EXPLAIN» SELECT a FROM b": "explain()", "a «>>» 2": "int(a / 2 ^ n)", "a «**» 2": "the power is ^",
    "a «//» 2": "a comment starts with #", "x «+=» 1": "write x = x + ...", "x «:=» 1": "write x = ...",
    "a «===» b": "write ==", "a «=>» b": "write >=", "[x «for» x in nums]": "(SELECT x FROM x = ... AS list)",
    "[x * 2 «for» n in nums]": "(SELECT x * 2 FROM n = ... AS list)", "«while» x < 5: x": "START WITH",
    "«def» f(x): return x": "session.function(f)", "«import» math": "session.function(f)",
    "x = «lambda» y: y": "session.function(f)", "«return» 5": "write 5 alone", "x = 1; «let» y = 5": "y = ...",
}  # fmt: skip
# Code, words of the message and of the hints, and scripts that give them; the place of the error stands between « and
# », the bracket that is open there between ‹ and ›.
ERRORS: list[tuple[str, ...]] = [
    # something is missing
    ("P002", "expected a condition after WHERE, found the end of the script", "", "SELECT a FROM b WHERE«»"),
    ("P001", "expected a condition after WHERE, found AND", "", "SELECT a FROM b WHERE «AND» c"),
    ("P001", "expected a value after AND, found STOP WITH", "", "SELECT a FROM b WHERE c AND «STOP» WITH d"),
    ("P002", "expected a source after FROM", "", "SELECT a FROM«»"),
    ("P001", "expected a source after FROM, found WHERE", "", "SELECT a FROM «WHERE» c"),
    ("P001", "expected a source after FROM, found FROM", "", "SELECT a FROM «FROM» c"),
    ("P001", "expected a column after SELECT, found FROM", "", "SELECT «FROM» b"),
    ("P002", "expected a column after SELECT", "", "SELECT«»"),
    ("P001", "expected a source after ',', found WHERE", COMMA, "SELECT a FROM b, «WHERE» c"),
    ("P001", "expected a source after ',', found START WITH", COMMA, "SELECT a FROM b, «START» WITH x = 1"),
    ("P002", "expected a value to group by after GROUP BY", "", "SELECT a FROM b GROUP BY«»"),
    ("P002", "expected a value to sort by after ORDER BY", "", "SELECT a FROM b ORDER BY«»"),
    ("P002", "expected a number after LIMIT", "", "SELECT a FROM b LIMIT«»"),
    ("P001", "expected a representation such as list or value after AS, found ';'", "", "SELECT a FROM b AS «;»"),
    ("P002", f"{STEP} after START WITH", "", "SELECT a FROM b START WITH«»"),
    ("P001", STEP, "", "SELECT a FROM b START WITH «CONNECT» BY x = 1"),
    ("P001", "found CONNECT BY", COMMA, "SELECT a FROM b START WITH x = 1, «CONNECT» BY x = 1"),
    ("P001", "expected a value after '=', found CONNECT BY", "", "SELECT a FROM b START WITH x = «CONNECT» BY x = 1"),
    ("P001", "expected '=' after 'x', found '=='", "WITH x = ...", "SELECT a FROM b START WITH x «==» 1"),
    ("P002", "expected an assignment", "NO CYCLE level = level", "SELECT a FROM b CONNECT BY UNIQUE«»"),
    ("P001", "expected an assignment such as level = level + 1", "", "SELECT a FROM b CONNECT BY «;»"),
    ("P001", "MEMORIZE takes a whole number, not '1.5'", "(n)", "SELECT a FROM b CONNECT BY MEMORIZE «1.5» x = 2"),
    ("P001", "expected '=' after 'n'", "MEMORIZE (n)", "SELECT a FROM b CONNECT BY MEMORIZE n «x» = 1"),
    ("P001", "a whole number or a value in parentheses after MAXIMUM, found 'n'", "",
     "SELECT a FROM b CONNECT BY MAXIMUM «n» x = 1"),
    ("P001", "a whole number or a value in parentheses after MAXIMUM, found '-'", "",
     "SELECT a FROM b CONNECT BY MAXIMUM «-» 1 x = 1"),
    ("P001", "COST needs a value", "write COST 1 x = ...", "SELECT a FROM b CONNECT BY COST x «=» 1"),
    ("P001", "NO stands behind an assignment", "right behind CONNECT", "SELECT a FROM b CONNECT BY x = 1, «NO» CYCLE"),
    ("P001", "expected FROM after the columns, found ';'", "SELECT ... FROM source", "SELECT a«;»"),
    ("P002", "expected FROM after *", "SELECT ... FROM source", "SELECT *«»"),
    ("P001", "expected FROM after the columns", "a value alone needs no SELECT: write 1 + 1", "SELECT 1 + 1«;»"),
    ("P001", "expected FROM between 'a' and 'b'", "write FROM b", "SELECT a «b»", "SELECT a «b» WHERE c"),
    ("P001", "expected an argument after ',', found ')'", COMMA, "f(1, «)»"),
    ("P001", "expected an argument after ',', found ';'", COMMA, "f‹(›a, «;»"),
    ("P001", "expected a value after ',', found ']'", COMMA, "[1, 2, «]»"),
    ("P001", "expected an index after '[', found ']'", "", "x[«]»"),
    ("P001", "expected a condition after '(', found ';'", "", "IF(«;» a)"),
    ("P001", "expected '(' after IF, found 'a'", "IF(condition; then; else)", "IF «a»; b"),
    ("P001", "expected IN after NOT, found 'b'", "", "a NOT «b»"),
    ("P001", "expected this or a column after '.', found ';'", "", "a.«;»"),
    ("P002", "expected a value after '+', found the end of the script", "", "3 +«»"),
    ("P001", "expected a value, found '+'", "leave the + out", "«+»5"),
    ("P001", "expected a value, found '*'", "", "«*»"),
    # keywords of two words, and misspelt ones
    *(("P001", f"expected {second} after {first}, found 'x'", f"{first} {second}", f"SELECT a FROM b {text} «x» = 1")
      for text, second in {"START": "WITH", "CONNECT": "BY", "GROUP": "BY", "ORDER": "BY", "CONNECT BY NO": "CYCLE",
                           "CONNECT BY DEPTH": "FIRST", "CONNECT BY BREADTH": "FIRST"}.items()
      for first in text.split()[-1:]),
    ("P001", "WITH does not fit here", "START WITH or STOP WITH", "SELECT a FROM b «WITH» x = 1"),
    ("P001", "BY does not fit here", "CONNECT BY, GROUP BY or ORDER BY", "SELECT a FROM b «BY» a"),
    *(("P001", "is not a keyword", f"did you mean {word}?", text) for text, word in {
        "«SELCT» a FROM b": "SELECT", "x = max(«SELCET» a FROM b)": "SELECT", "SELECT a, c «FRMO» b": "FROM",
        "SELECT a FROM b «WHER» c": "WHERE", "SELECT a FROM b WHERE c «ADN» d": "AND",
        "SELECT a FROM b «STRAT» WITH x = 1": "START WITH", "SELECT a FROM b «CONECT» BY x = 1": "CONNECT BY",
        "SELECT a FROM b WHERE c «STPO» WITH x": "STOP WITH", "SELECT a FROM b «GRUOP» BY c": "GROUP BY",
        "SELECT a FROM b «GROUPBY» c": "GROUP BY", "SELECT a FROM b GROUP BY c «HAVNIG» d": "HAVING",
        "SELECT a FROM b «ODER» BY c": "ORDER BY", "SELECT a FROM b ORDER BY c «DESCENDING»": "DESC",
        "SELECT a FROM b ORDER BY c «ACS»": "ASC", "SELECT a FROM b «LIMTI» 3": "LIMIT",
        "SELECT a FROM b CONNECT BY «UNIQE» x = 1": "UNIQUE",
        "SELECT a FROM b CONNECT BY «NOCYCLE» x = 1": "NO CYCLE",
        "SELECT a FROM b CONNECT BY «DEPTHFIRST» x = 1": "DEPTH FIRST",
        "SELECT a FROM b CONNECT BY «MEMOIZE» 5 x = 1": "MEMORIZE",
    }.items()),
    ("P001", "'MAX' is not a keyword", "MAXIMUM", "SELECT a FROM b START WITH n = 1 CONNECT BY «MAX» 3 n = 2"),
    # clauses in the wrong place
    ("P001", "WHERE stands before START WITH", ORDER, "SELECT a FROM b START WITH x = 1 «WHERE» c"),
    ("P001", "START WITH stands before CONNECT BY", ORDER, "SELECT a FROM b CONNECT BY x = 1 «START» WITH x = 1"),
    ("P001", "CONNECT BY stands before STOP WITH", ORDER, "SELECT a FROM b STOP WITH c «CONNECT» BY x = 1 WHERE d"),
    ("P001", "STOP WITH stands before ORDER BY", ORDER, "SELECT a FROM b ORDER BY c «STOP» WITH c"),
    ("P001", "STOP WITH stands twice", "join the conditions with OR", "SELECT a FROM b STOP WITH c «STOP» WITH d"),
    ("P001", "GROUP BY stands twice", "write one list", "SELECT a FROM b GROUP BY c LIMIT 1 «GROUP» BY d"),
    ("P001", "ORDER BY stands twice", "write one list", "SELECT a FROM b ORDER BY c «ORDER» BY d"),
    ("P001", "LIMIT stands twice", "keep one", "SELECT a FROM b LIMIT 1 «LIMIT» 2"),
    ("P001", "a query starts with SELECT, not with WHERE", "the order is SELECT, FROM", "«WHERE» x == 1"),
    ("P001", "a query starts with SELECT, not with FROM", "SELECT ... FROM", "«FROM» a SELECT b"),
    ("P001", "WHERE does not fit here", WHOLE_ORDER, "a «WHERE» b"),
    ("P001", "FROM does not fit here", WHOLE_ORDER, "let «FROM»"),
    ("P001", "has no name", "positional arguments come first", "SELECT a FROM b AS plane(x = 3, «5»)"),
    ("P001", "DESC stands behind the value", "write c DESC", "SELECT a FROM b ORDER BY «DESC» c"),
    # queries that nothing ends
    ("P009", UNENDED, AS_OR_PARENTHESES,
     "SELECT a FROM «SELECT b FROM c WHERE d»;", "SELECT a FROM n = «SELECT b FROM c»",
     "SELECT «SELECT a FROM b» FROM c", *(f"SELECT a FROM b {clause} «SELECT c FROM d»" for clause in (
         "WHERE c ==", "WHERE NOT c IN", "CONNECT BY x =", "STOP WITH", "GROUP BY", "GROUP BY a HAVING", "ORDER BY",
         "LIMIT")), "SELECT a FROM b START WITH x = «SELECT c FROM d, y = 1»",
     "SELECT a FROM b CONNECT BY COST «SELECT c FROM d» y = 1"),
    ("P009", "to the left of IN is not ended", "to name a source write FROM b = ...", "«SELECT a FROM b» IN [1, 2]"),
    ("P009", "to the left of + is not ended", "FROM (a + b)", "max(«SELECT a FROM b» + 1)", "«SELECT a FROM b» + 1"),
    ("P009", "to the left of == stands in paren", "(SELECT ... AS list) == ...", "«SELECT a FROM b AS list» == []"),
    ("P009", "to the left of < stands", "(SELECT ... AS value) < ...", "c + «SELECT a FROM b AS value» < d"),
    ("P009", "to the left of NOT IN", "(SELECT ... AS list) NOT IN ...", "«SELECT a FROM b AS list» NOT IN c"),
    ("P009", "to the left of '^' stands in parentheses", "(SELECT ... AS value)^", "SELECT a FROM b AS value «^» 2"),
    # what does not fit
    ("P001", "a comparison does not go on with '<'", "a < b AND b < c", "a < b «<» c"),
    ("P001", "a comparison does not go on with IN", "a < b AND b < c", "a == b «IN» c"),
    ("P001", "a comparison does not go on with NOT IN", "a < b", "SELECT a FROM b WHERE c OR 1 IN a «NOT IN» d"),
    ("P001", "only a name can be assigned here, not [1]", "write [1] == 5 to compare", "[1] «=» 5"),
    ("P001", "only a name can be assigned here, not f(x)", "write f(x) == 3", "f(x) «=» 3"),
    ("P001", "only a name can be assigned here, not n.a", "write n.a == 3", "n.a «=» 3"),
    ("P001", "only a name can be assigned here, not 3", "write 3 == x", "3 «=» x"),
    ("P001", "FROM is a reserved word, not a name", "choose another name", "«from» = 3"),
    ("P001", "THIS is a reserved word, not a name", "choose another name", "«this» = 3"),
    ("P001", "FROM is a reserved word, not a name", 'write n["from"]', "x = n.«from»"),
    ("P001", "the string 'it' ends at its second '", 'the string stands in "', "x = 'it'«s» + 1"),
    ("P001", "a dot stands behind the name of a source only, not behind a.b", 'write a.b["c"]', "a.b«.»c"),
    ("P001", "a dot stands behind the name of a source only, not behind f(x)", 'write f(x)["y"]', "f(x)«.»y"),
    ("P001", "a dict cannot be written", "from Python", "x = «{»'a': 1}"),
    ("P001", "does not say how many seconds to keep", "v{5.0} =", "«v{}» = 3"),
    ("P001", "';' does not fit here in IF", "IF(a; b, c; d)", "IF(a; b; c«;» d)"),
    ("P001", "',' does not fit here in IF", "IF(a; b, c; d)", "IF(a«,» b)"),
    ("P001", "between 'a' and IF", "IF(condition; then; else)", "x = a «if» b else c"),
    ("P001", "expected an operator or ';' between 'print' and 'x'", "print('x')", "print «'x'»"),
    ("P001", "expected an operator or ';' between 'len' and 'x'", "len(x)", "len «x»"),
    ("P001", "expected an operator or ';' between 'y' and 'z'", "statements are separated by ;", "x = y\n«z»"),
    ("P001", "NOT does not go with =", "write c != ...", "SELECT a FROM b WHERE c «NOT» = 3"),
    ("P001", "NOT does not go with ==", "write c != ...", "SELECT a FROM b WHERE c «NOT» == 3"),
    ("P001", "between 'x' and ','", "a list stands in square brackets", "SELECT a FROM b WHERE c IN 'x'«,» 'y'"),
    ("P001", "expected ',', a clause or ';' between 'b' and 't'", "write t = b", "SELECT a FROM b «t» WHERE c"),
    ("P001", "expected ',', a clause or ';' between ')' and '1'", "in parentheses", "SELECT a FROM f(b) «1»"),
    ("P001", "expected ',', a clause or ';' between 'b' and 'where'", "write where = b", "SELECT a FROM b «where» = 3"),
    ("P001", "expected an operator, a clause or ';' between 'c' and 'd'", "", "SELECT a FROM b WHERE c «d»"),
    ("P001", "between DESC and 'd'", "", "SELECT a FROM b ORDER BY c DESC «d»"),
    # brackets
    ("P001", "']' closes nothing", "open it with '['", "x = 3«]»"),
    ("P001", "expected ')' before ';'", "write the missing ')'", "x = ‹(›1 + 2«;»", "max‹(›SELECT a FROM b AS set«;»"),
    ("P001", "expected ']' before ';'", "write the missing ']'", "x = ‹[›1, f(2)«;»"),
    ("P001", "expected ']' before ';'", LISTS, "x = ‹[›1«;» 2]"),
    ("P001", "expected ')' before FROM", "write the missing ')'", "SELECT f‹(›a «FROM» b"),
    ("P001", "expected ')' before WHERE", "write the missing ')'", "SELECT a FROM f‹(›b «WHERE» c"),
    ("P002", "the script ends before '(' is closed", "write the missing ')'",
     "x = f‹(›1, [2]«»", "SELECT a FROM b WHERE ‹(›f(c) AND d«»"),
    ("P002", "expected an argument after '(', found the end of the script", "", "f‹(›«»"),
    ("P001", "expected an operator, ',' or ')' between ']' and 'b'", "", "f‹(›a[1] «b»)"),
    ("P001", "expected an operator, ',' or ']' between 'a' and 'b'", LISTS, "‹[›a «b»]"),
    ("P001", "expected an operator, ',' or ']' between '2' and 'y'", LISTS, "x = ‹[›1, 2\n«y» = 3"),
    ("P001", "expected an operator or '}' between '1' and '2'", "", "v‹{›1 «2»}"),
    ("P001", "between '1' and ':'", "range(from, to)", "x = [1«:»2]"),
    ("P001", "between ')' and '{'", "IF(condition; then; else)", "if (a > b) «{» c }"),
    # what cannot be read
    ("P003", "this string is not closed", "write ' at its end", "x = «'abc;»\n"),
    ("P003", "no character '?'", "IF(condition; then; else)", "x = a «?» b : c"),
    ("P003", "the language has no character '$'", "parameter", "x = 3 «$» 4"),
    ("P003", "the language has no character '@'", "parameter", "«@»x"),
    ("P003", "the language has no character '`'", 'x["key"]', "x = «`»a`"),
    ("P003", "the language has no character '\\'", "next line", "a «\\» b"),
    ("P003", "'→' (U+2192 RIGHTWARDS ARROW)", "", "x «→» y"),
    ("P003", "'²' (U+00B2 SUPERSCRIPT TWO)", "", "x = größe«²»"),
    ("P003", "LEFT DOUBLE QUOTATION MARK", "strings stand in", "«“»abc”"),
    ("P003", "LESS-THAN OR EQUAL TO", "write <=", "3«≤»b", "a «≤» b"),
    ("P003", "U+0001", "", "a «\x01» b"),
    ("P003", "U+200B ZERO WIDTH SPACE", "", "a«\u200b»b"),
    ("P003", "contains a NUL character", "binary", "a«\0»b", "x = 1;«\0»", "\x7fELF\x02\x01\x01«\0»\0\0"),
    ("P003", "half of a character, U+D800", "Unicode", "a = '«\ud800»'"),
    ("P003", "'1_000' is neither a number nor a name", "without units", "x = «1_000»"),
    ("P003", "'0x1F' is neither a number nor a name", "without units", "«0x1F»"),
    ("P003", "this escape is not complete: \\x", "\\x41", "x = '«\\x»4'"),
    ("P003", "this escape is not complete: \\u", "\\u0041", "x = '«\\u»00g0'"),
    ("P003", "no character named 'NO SUCH NAME'", "", "x = '«\\N{NO SUCH NAME}»'"),
    ("P003", "\\ud800 is not a character", "U0010ffff", "x = 'a«\\ud800»'"),
    ("P003", "\\U00110000 is not a character", "U0010ffff", "x = '«\\U00110000»'"),
    ("P007", "beyond 64 bits", "1e30 is a float", "a = -(«9223372036854775808»)", "a = -«9223372036854775808»[0]",
     "a = -«9223372036854775808» ^ 2", "a = -«9223372036854775809»"),
    ("P008", "no statement", "SELECT this FROM", "«»", "«» ; # nothing\n ;; /* at all */"),
    # SQL: conditions
    ("P006", "WHERE needs a condition", "write b == 2", "SELECT a FROM b WHERE a == 1 AND b «=» 2"),
    ("P006", "WHERE needs a condition", "write n.c == 'x'", "SELECT a FROM b WHERE n.c «=» 'x' OR d"),
    ("P006", "WHERE needs a condition", "write f(a, b)[0] == ...", "SELECT a FROM b WHERE f(a, b)[0] «=» f(c)"),
    ("P006", "WHERE needs a condition", "write a == 3", "SELECT a FROM b WHERE («a = 3»)"),
    ("P006", "WHERE needs a condition", "write a == None", "SELECT a FROM b WHERE a «=» NULL"),
    ("P006", "WHERE needs a condition", "write b.x == c.y", "SELECT a FROM b, c WHERE b.x «=» c.y AND d"),
    ("P006", "WHERE needs a condition", "write a == ...", "SELECT a FROM b WHERE a «=» b.f(c)"),
    ("P006", "STOP WITH needs", "write x == 7", "SELECT a FROM b STOP WITH («x = 7»)"),
    ("P006", "HAVING needs", "write sum(c) == 7", "SELECT a FROM b GROUP BY a HAVING sum(c) «=» 7"),
    ("P006", "HAVING needs", "write c == 7", "SELECT a FROM b GROUP BY a HAVING («c = 7»)"),
    ("P006", "IF needs a condition", "write a == 1", "IF((«a = 1»); b)"),
    ("P006", "no IS NOT in", "write n.a != None", "SELECT a FROM b WHERE n.a «IS» NOT NULL"),
    ("P006", "no NOT BETWEEN", "write NOT (low <= a AND a <= high)", "SELECT a FROM b WHERE a NOT «between» 1 AND 2"),
    ("P006", "no LIKE", "'part' IN a", "SELECT a FROM b WHERE a «LIKE» 'x_y'", "SELECT a FROM b WHERE a «LIKE» 'x%y'",
     "SELECT a FROM b WHERE a «LIKE» c"),
    ("P006", "no NOT LIKE", "'part' NOT IN a", "SELECT a FROM b WHERE a NOT «LIKE» 'x%'"),
    # SQL: columns and sources
    ("P006", "AS does not name a column", "write to(mass * 2, y)", "SELECT z, mass * 2 «AS» y FROM t"),
    ("P006", "expected ',' or FROM", "write to(f(x, 1), y)", "SELECT f(x, 1) «y» FROM t"),
    ("P006", "expected ',' or FROM", "write to(x, y)", "SELECT x «y», z FROM t"),
    ("P006", "a column is not assigned", "write to(3, a)", "SELECT a «=» 3 FROM t"),
    ("P006", "* is the only column", "write SELECT *", "SELECT *«,» a FROM b", "SELECT a, «*» FROM b"),
    ("P006", "no DISTINCT", "uniq(SELECT ... AS list)", f"SELECT «DISTINCT» x FROM b WHERE {'x + ' * 20}x > 1"),
    ("P006", "no LEFT", JOIN, "SELECT a FROM b «LEFT» JOIN c ON b.x == c.x"),
    ("P006", "no ON", JOIN, "SELECT a FROM b, c «ON» b.x == c.x"),
    ("P006", "LIMIT has one number", "(SELECT ... AS list)[offset:]", "SELECT a FROM b LIMIT 5«,» 3"),
    ("P006", "AS ends the query, ',' cannot follow", "FROM t = ...", "SELECT a FROM b AS t«,» c AS u"),
    ("P006", "AS ends the query, LIMIT cannot follow", "is the last clause", "SELECT a FROM b AS list «LIMIT» 3"),
    ("P006", "START WITH are separated by commas", "WITH ..., m = 1", "SELECT a FROM b START WITH n = 0 «AND» m = 1"),
    ("P006", "CONNECT BY are separated", "BY ..., n = 2", "SELECT a FROM b CONNECT BY n = 1 «AND» n = 2"),
    # SQL: operators and statements
    *(("P006", f"a script only reads, there is no {word.upper()}", "from Python", f"«{word}» a SET b = 3")
      for word in ("update", "DELETE", "CREATE", "ATTACH", "PRAGMA")),
    ("P006", "a list stands in square brackets", "write [1, 2]", "x IN (1«,» 2)"),
    ("P006", "a list stands in square brackets", "write [1, ...]", "x = 1«,» 2"),
    ("P006", "a list stands in square brackets", "a fraction has a point: 1.5", "x = 1«,»5"),
    ("P006", "-- does not start a comment", "write #", "SELECT a FROM b «--»of_them", "«--» a comment\ny = 2"),
    ("P006", "two strings", r"written \'", "'it'«'s'»"),
    ("P006", "a parameter has no sign", "write a alone", "x = «:»a"),
    # Python and others
    *(("P006", f"no {'' if word.isalpha() else 'operator '}{word}", hint, text) for text, hint in FOREIGN.items()
      for word in re.findall("«(.*)»", text)),
    ("P006", "no operator ..", "write range(1, 10)", "1.«.10»"),
    ("P006", "a slice has no step", "x[a:b]", "x[:«:»2]", "x[1:2«:»3]"),
    ("P006", "no f stands in front of a string", "join the parts with +", "«f»'{x}'"),
    ("P006", "no r stands in front of a string", "for a backslash", "x = «r»'abc'"),
    ("P006", "an element is not assigned", "assign a new list to x", "x[0] «=» y[1]"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("marked", "code", "message", "hint"), [(text, *row[:3]) for row in ERRORS for text in row[3:]], ids=ascii
)
def test_an_error_has_a_code_a_place_a_reason_and_a_cure(marked: str, code: str, message: str, hint: str) -> None:
    check(marked, code, message, hint)


# --- several errors at once ------------------------------------------------------------------------------


def places(source: str) -> list[tuple[str, str]]:
    """Code and line:column of every error."""
    return [(error.code, error.span.place.split(":", 1)[1]) for error in failure(source).errors if error.span]


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("x = ;\ny = 3 +;\nz = 4;\nSELECT a FORM b;\nw = (1", "P001 1:5, P001 2:8, P001 4:10, P002 5:7"),
        ("x = 'abc;\ny = 3 3;\nz = 1 $ 2 $ 3; u = -'\\x';", "P003 1:5, P001 2:7, P003 3:7, P003 3:22"),
        ("x = 1e999; y = ; z = SELECT a FROM SELECT b FROM c; w = 1 2;", "P007 1:5, P001 1:16, P009 1:36, P001 1:59"),
        # an open bracket ends with its statement
        ("x = (1 + 2;\ny = 3 3;", "P001 1:11, P001 2:7"),
        ("x = f(1, [2;\nIF(a; b; c);\ny = 3 3;", "P001 1:12, P001 3:7"),
    ],
    ids=ascii,
)
def test_each_statement_has_its_error(source: str, found: str) -> None:
    assert ", ".join(map(" ".join, places(source))) == found


@pytest.mark.parametrize(
    "source",
    ["IF(a b; c d; e f)", "f(IF(a; b; c; d), IF(a; b; c; d))",
     "SELECT a b c FROM d e WHERE f = g AND h = IF(i = j; k; l)", "x = [1, 2 3, f(4 5; 6)]",
     "SELECT a FROM b STOP WITH c START WITH d = 1 WHERE e"],
)  # fmt: skip
def test_errors_inside_a_statement_do_not_multiply(source: str) -> None:
    assert len(places(source)) == 1
    assert places(f"{source}; y = = 2") == [*places(source), ("P001", f"1:{len(source) + 7}")]


def test_at_most_ten_errors_are_told() -> None:
    error = failure("x = ;\n" * 50)
    assert len(error.errors) == 10
    assert error.errors[0] is error
    assert str(error).count("error[P001]") == 10
    assert places("9223372036854775808;" * 50) == [("P007", f"1:{20 * number + 1}") for number in range(10)]
