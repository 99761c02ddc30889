"""Makes the LALR table of the parser: lark compiles `grammar.lark`.

`python -m ss2sql.frontend.syntax.parse_table` writes `grammar_table.json`, which ships and runs without lark.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from ss2sql.frontend.syntax.parser import GRAMMAR, TABLE


def write_parse_table() -> None:
    """Writes the table beside the grammar, with the same bytes on every machine."""
    TABLE.write_text(json.dumps(build_parse_table(), separators=(",", ":"), sort_keys=True) + "\n", encoding="utf-8")


def build_parse_table() -> dict[str, Any]:
    """The table as JSON data, compiled by lark: states are numbered in the order of a walk from the start."""
    import lark
    from lark.grammar import Rule as LarkRule
    from lark.lexer import TerminalDef

    compiled = lark.Lark(GRAMMAR.read_text("utf-8"), parser="lalr", start="script", maybe_placeholders=False)
    data, memo = compiled.memo_serialize([TerminalDef, LarkRule])
    table = data["parser"]["parser"]
    words = {d["name"]: d["pattern"]["value"].upper() for d in memo.values() if d["__type__"] == "TerminalDef"}
    names = {number: words.get(name, name) for number, name in table["tokens"].items()}
    actions = {state: {names[number]: target for number, target in r.items()} for state, r in table["states"].items()}
    rules = sorted(_encode_grammar_rule(d, words) for d in memo.values() if d["__type__"] == "Rule")
    number_of = {json.dumps(_encode_grammar_rule(d, words)): key for key, d in memo.items() if d["__type__"] == "Rule"}
    rule_index = {number_of[json.dumps(rule)]: index for index, rule in enumerate(rules)}
    order = _number_parser_states(actions, table["start_states"]["script"])
    rows = [
        {symbol: ~rule_index[target["@"]] if reduces else order[target] for symbol, (reduces, target) in row.items()}
        for row in (actions[state] for state in order)
    ]
    return _pack_parse_table(rows, rules, order[table["end_states"]["script"]])


def _number_parser_states(actions: Mapping[int, Mapping[str, tuple[int, Any]]], start: int) -> dict[int, int]:
    """New numbers of all states: the order of a walk from `start`, by symbol."""
    order = {start: 0}
    queue = [start]
    for state in queue:
        for _, (reduces, target) in sorted(actions[state].items(), key=lambda item: item[0]):
            if not reduces and target not in order:
                order[target] = len(order)
                queue.append(target)
    return order


def _encode_grammar_rule(rule: Mapping[str, Any], words: Mapping[str, str]) -> list[Any]:
    """A rule of lark as `[origin, symbols, action, children]`."""
    origin, options = rule["origin"]["name"], rule["options"]
    kept: list[int] = []
    for index, symbol in enumerate(rule["expansion"]):
        if symbol["name"].startswith("_") and symbol["name"] not in words:
            kept.append(~index)
        elif not symbol.get("filter_out"):
            kept.append(index)
    action: str | None = rule["alias"] or ("" if origin.startswith("_") else origin)
    if options["expand1"] and not rule["alias"] and kept == [0] and len(rule["expansion"]) == 1:
        action = None
    return [origin, [words.get(s["name"], s["name"]) for s in rule["expansion"]], action or "", action is None, kept]


def _pack_parse_table(rows: list[dict[str, int]], rules: list[list[Any]], end: int) -> dict[str, Any]:
    """The JSON form: symbols are numbered, states with equal rows share one."""
    symbols = sorted({symbol for row in rows for symbol in row} | {rule[0] for rule in rules})
    number = {symbol: index for index, symbol in enumerate(symbols)}
    packed = [sorted((number[symbol], target) for symbol, target in row.items()) for row in rows]
    unique = sorted({tuple(row) for row in packed})
    return {
        "symbols": symbols,
        "found": [[symbol for symbol, _ in row] for row in unique],
        "targets": [[target for _, target in row] for row in unique],
        "states": [unique.index(tuple(row)) for row in packed],
        "rules": [
            [number[origin], len(expansion), None if passes else action, kept]
            for origin, expansion, action, passes, kept in rules
        ],
        "start": 0,
        "end": end,
    }


if __name__ == "__main__":
    write_parse_table()
