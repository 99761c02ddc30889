"""Errors are data: a code, a sentence, a place and hints; one renderer turns them into text.

Every error that ss2sql raises itself is an `Error`. A Python function of the user that raises keeps its
own exception type and gets a note with the line of the script (see `note_place`).

- errors/places.py: scripts, and stretches of them
- errors/codes.py: the table of codes
- errors/family.py: the classes of errors
- errors/hints.py: known names that are similar to the one that was written; hints in the words of a shell
- errors/notes.py: the note on exceptions of the user
- errors/render.py: the text of an error
"""

from ss2sql.errors.codes import CODES as CODES
from ss2sql.errors.codes import Code as Code
from ss2sql.errors.family import Cancelled as Cancelled
from ss2sql.errors.family import Error as Error
from ss2sql.errors.family import ExecutionError as ExecutionError
from ss2sql.errors.family import OutOfMemory as OutOfMemory
from ss2sql.errors.family import OutOfSteps as OutOfSteps
from ss2sql.errors.family import ParseError as ParseError
from ss2sql.errors.family import RepresentationError as RepresentationError
from ss2sql.errors.family import ResolveError as ResolveError
from ss2sql.errors.family import SessionError as SessionError
from ss2sql.errors.family import Stopped as Stopped
from ss2sql.errors.family import Timeout as Timeout
from ss2sql.errors.family import UnsupportedError as UnsupportedError
from ss2sql.errors.family import WorkersWarning as WorkersWarning
from ss2sql.errors.family import several as several
from ss2sql.errors.hints import did_you_mean as did_you_mean
from ss2sql.errors.hints import respell as respell
from ss2sql.errors.hints import similar as similar
from ss2sql.errors.notes import note_once as note_once
from ss2sql.errors.notes import note_place as note_place
from ss2sql.errors.places import Source as Source
from ss2sql.errors.places import Span as Span
from ss2sql.errors.render import render as render
from ss2sql.errors.render import render_all as render_all
