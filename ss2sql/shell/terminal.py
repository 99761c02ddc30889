"""The shell on a terminal, with prompt_toolkit: its colors and the history of input."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from prompt_toolkit import PromptSession
from prompt_toolkit.auto_suggest import AutoSuggestFromHistory
from prompt_toolkit.completion import CompleteEvent, Completer, Completion
from prompt_toolkit.document import Document
from prompt_toolkit.filters import has_completions, has_focus, is_searching
from prompt_toolkit.formatted_text import StyleAndTextTuples
from prompt_toolkit.history import FileHistory, History, InMemoryHistory
from prompt_toolkit.key_binding import KeyBindings, KeyPressEvent
from prompt_toolkit.lexers import PygmentsLexer
from prompt_toolkit.output import create_output
from prompt_toolkit.styles import Style
from pygments.lexer import Lexer
from pygments.token import Keyword, Text
from pygments.token import _TokenType as Type

import ss2sql
from ss2sql.editor.lexer import SelectScriptLexer
from ss2sql.shell.completion import find_signature_at_cursor, suggest_completions
from ss2sql.shell.dot_commands import EXAMPLE, SETTINGS, ExitRequest, Settings, format_setting
from ss2sql.shell.shell import Shell
from ss2sql.shell.statement_splitter import is_typed_input_ready, split_statements
from ss2sql.shell.symbols import SymbolTable

STYLE = {
    "pygments.keyword": "ansiblue bold",
    "pygments.keyword.constant": "ansicyan",
    "pygments.keyword.type": "ansicyan",
    "pygments.keyword.pseudo": "ansimagenta bold",
    "pygments.operator.word": "ansiblue bold",
    "pygments.name.builtin.pseudo": "ansicyan",
    "pygments.name.function": "ansigreen",
    "pygments.literal.string": "ansiyellow",
    "pygments.literal.number": "ansimagenta",
    "pygments.comment": "italic",
    "pygments.error": "ansired underline",
    "argument": "bold underline",
}


class ShellLexer(Lexer):
    """Statements as SelectScriptLexer colors them, and dot commands between them."""

    name = "ss2sql shell"

    def get_tokens_unprocessed(self, text: str) -> Iterator[tuple[int, Type, str]]:
        """Every token of the text with its place and its kind."""
        position = 0
        for piece in split_statements(text):
            if piece.is_command:
                yield from _color_shell_input(text[position : piece.start], position)
                name = piece.text.split()[0]
                yield piece.start, Keyword.Pseudo, name
                position = piece.start + len(name)
                if name not in (".sql", ".explain"):
                    yield position, Text, text[position : piece.end]
                    position = piece.end
        yield from _color_shell_input(text[position:], position)


def _color_shell_input(text: str, start: int) -> Iterator[tuple[int, Type, str]]:
    for position, kind, part in SelectScriptLexer().get_tokens_unprocessed(text):
        yield start + position, kind, part


# --- the history of input: a file in the user's state folder that only the user can read
def find_state_folder() -> Path:
    """The folder for programs' state, by the XDG rules."""
    folder = os.environ.get("XDG_STATE_HOME", "")
    base = Path(folder) if os.path.isabs(folder) else Path.home() / ".local" / "state"
    return base / "ss2sql"


def open_history_file() -> Path:
    """The file, created if missing, readable by its owner alone. Raises OSError."""
    folder = find_state_folder()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    path = folder / "history"
    # O_NOFOLLOW: somebody else's link would make the shell write to its target.
    number = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o600)
    if hasattr(os, "fchmod"):
        os.fchmod(number, 0o600)
    os.close(number)
    return path


PROMPT, MORE = "ss> ", "..> "
# Words that newcomers type to leave or to get help, each alone on a line.
PLAIN_WORDS = {"exit": ".exit", "quit": ".exit", "\\q": ".exit", "help": ".help", "?": ".help", "\\h": ".help"}


def interpret_input(text: str, shell: Shell) -> str:
    """The input, or the dot command that a newcomer most likely means by it."""
    word = text.strip().removesuffix(";").strip()
    return PLAIN_WORDS.get(word.lower(), text) if word not in shell.session.host.names else text


class Terminal:
    """The loop of a shell: prompts and runs. Tests give `input` and `output` of prompt_toolkit."""

    def __init__(self, shell: Shell, remembers: bool = True, **streams: Any) -> None:
        self.shell = shell
        self.known = SymbolTable(shell.session)
        if "output" not in streams:
            streams["output"] = create_output(always_prefer_tty=True)  # results may go to a file
        self.prompts: PromptSession[str] = PromptSession(
            PROMPT,
            multiline=True,
            prompt_continuation=lambda width, line, wrapped: MORE if not wrapped else "",
            lexer=PygmentsLexer(ShellLexer),
            completer=_Completer(self),
            complete_while_typing=True,
            auto_suggest=AutoSuggestFromHistory(),
            history=self._open_history(remembers),
            bottom_toolbar=lambda: self.describe_toolbar(self.prompts.default_buffer.document),
            key_bindings=self._bind_keys(),
            style=Style.from_dict(STYLE),
            include_default_pygments_style=False,
            enable_open_in_editor=True,
            tempfile_suffix=".ss",
            **streams,
        )

    def run_until_exit(self) -> None:
        """Prompts and runs until the user leaves."""
        welcome = f"""ss2sql {ss2sql.__version__}: SelectScript on SQLite. Statements end with ;  for example
  {EXAMPLE}
.help shows what there is, Tab completes, Ctrl-D leaves."""
        print(welcome, file=sys.stdout if sys.stdout.isatty() else sys.stderr)  # a file gets results only
        while True:
            try:
                self.shell.run_text(interpret_input(self.prompts.prompt(), self.shell))
            except (EOFError, ExitRequest):
                return
            except KeyboardInterrupt:
                continue
            finally:
                self.known = SymbolTable(self.shell.session)

    def _open_history(self, remembers: bool) -> History:
        if not remembers:
            return InMemoryHistory()
        try:
            return _ShellHistory(open_history_file())
        except (OSError, RuntimeError) as error:  # RuntimeError: no home folder
            print(f"what you type will not be remembered: {error}", file=sys.stderr)
            return InMemoryHistory()

    def _bind_keys(self) -> KeyBindings:
        keys = KeyBindings()

        @keys.add("enter", filter=has_focus("DEFAULT_BUFFER") & ~is_searching)
        def press_enter(event: KeyPressEvent) -> None:
            """Accepts the chosen completion, runs complete input, or begins a new line."""
            buffer = event.current_buffer
            if buffer.complete_state is not None and buffer.complete_state.current_completion is not None:
                buffer.complete_state = None
            elif "\n" not in buffer.document.text_after_cursor and (
                is_typed_input_ready(buffer.text) or interpret_input(buffer.text, self.shell) != buffer.text
            ):
                buffer.validate_and_handle()
            else:
                buffer.newline(copy_margin=False)

        @keys.add("tab", filter=has_focus("DEFAULT_BUFFER") & has_completions)
        def press_tab(event: KeyPressEvent) -> None:
            """Accepts the only completion, or chooses the next one."""
            buffer = event.current_buffer
            assert buffer.complete_state is not None
            found = buffer.complete_state.completions
            if len(found) == 1 and buffer.complete_state.current_completion is None:
                buffer.apply_completion(found[0])
            else:
                buffer.complete_next()

        return keys

    def describe_toolbar(self, document: Document) -> StyleAndTextTuples:
        """The call around the cursor, or a hint."""
        found = find_signature_at_cursor(document.text, document.cursor_position, self.known)
        if found is not None:
            entry, argument = found
            return list(_format_signature(entry.name, entry.parameters or (), argument, entry.about))
        return [("", self._choose_hint(document.text))]

    def _choose_hint(self, text: str) -> str:
        if "\n" in text and not is_typed_input_ready(text):
            return " a statement ends with ;  Ctrl-C clears"
        changed = [
            f"{name} {format_setting(getattr(self.shell.settings, name))}"
            for name in SETTINGS
            if getattr(self.shell.settings, name) != getattr(Settings(), name)
        ]
        return " " + "   ".join([*changed, ".help", "Tab completes", "Ctrl-D leaves"])


def _format_signature(name: str, parameters: tuple[str, ...], argument: int, about: str) -> Iterator[tuple[str, str]]:
    """A call with its current argument marked, and the function's description."""
    yield "", f" {name}("
    for index, parameter in enumerate(parameters):
        repeats = index == len(parameters) - 1 and parameter.startswith("*")
        style = "class:argument" if index == argument or (repeats and argument > index) else ""
        yield from (("", ", " if index else ""), (style, parameter))
    yield "", f")  {about}"


class _Completer(Completer):
    """The suggestions of shell/completion.py; while typing only where a word has begun."""

    def __init__(self, terminal: Terminal) -> None:
        self.terminal = terminal

    def get_completions(self, document: Document, complete_event: CompleteEvent) -> Iterable[Completion]:
        before = document.text_before_cursor
        if not complete_event.completion_requested and not (before[-1:].isalnum() or before[-1:] in ("_", ".")):
            return
        for one in suggest_completions(document.text, document.cursor_position, self.terminal.known):
            yield Completion(
                one.text, -one.length, display=one.shown or one.text, display_meta=one.about, style=f"class:{one.kind}"
            )


class _ShellHistory(FileHistory):
    """A history without texts that begin with a blank, which works without its file."""

    def append_string(self, string: str) -> None:
        if string.strip() and not string[0].isspace():
            super().append_string(string)

    def load_history_strings(self) -> Iterable[str]:
        try:
            return list(super().load_history_strings())
        except OSError:  # otherwise prompt_toolkit shows a traceback and waits for Enter
            return ()

    def store_string(self, string: str) -> None:
        try:
            super().store_string(string)
        except OSError:  # a full disk does not end a session; the entry is in memory
            return
