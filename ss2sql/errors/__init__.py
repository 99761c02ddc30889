"""Errors as data: a code, a sentence, a span of the script and hints; one renderer makes text of them.

Every error that ss2sql raises itself is an `Error`. An exception of a user's function keeps its own type and gets a
note that names the line of the script. In order: codes, exceptions.
"""

from ss2sql.errors.codes import CODES as CODES
from ss2sql.errors.codes import Code as Code
from ss2sql.errors.exceptions import NOWHERE as NOWHERE
from ss2sql.errors.exceptions import Cancelled as Cancelled
from ss2sql.errors.exceptions import Error as Error
from ss2sql.errors.exceptions import ExecutionError as ExecutionError
from ss2sql.errors.exceptions import OutOfMemory as OutOfMemory
from ss2sql.errors.exceptions import OutOfSteps as OutOfSteps
from ss2sql.errors.exceptions import ParseError as ParseError
from ss2sql.errors.exceptions import RepresentationError as RepresentationError
from ss2sql.errors.exceptions import ResolveError as ResolveError
from ss2sql.errors.exceptions import SessionError as SessionError
from ss2sql.errors.exceptions import Source as Source
from ss2sql.errors.exceptions import Span as Span
from ss2sql.errors.exceptions import Stopped as Stopped
from ss2sql.errors.exceptions import Timeout as Timeout
from ss2sql.errors.exceptions import UnsupportedError as UnsupportedError
from ss2sql.errors.exceptions import WorkersWarning as WorkersWarning
from ss2sql.errors.exceptions import combine_errors as combine_errors
from ss2sql.errors.exceptions import join_words as join_words
from ss2sql.errors.exceptions import note_on_exception as note_on_exception
from ss2sql.errors.exceptions import note_place_on_exception as note_place_on_exception
from ss2sql.errors.exceptions import render_all as render_all
from ss2sql.errors.exceptions import render_error as render_error
from ss2sql.errors.exceptions import require_package as require_package
from ss2sql.errors.exceptions import suggest_names as suggest_names
from ss2sql.errors.exceptions import suggest_similar as suggest_similar
