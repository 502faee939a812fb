"""The help as a whole: every command, in groups, at once; and the nearest match of a command that there is not."""

from __future__ import annotations

import subprocess
import sys
from typing import Literal, get_args, get_origin

from lumpwatch.service.bus import Role
from lumpwatch.service.cli import _MODULES, of_command, parser
from lumpwatch.service.cli.arguments import operate, schema, users, verdict
from lumpwatch.service.cli.overview import GROUPS
from lumpwatch.service.config import UserRole
from lumpwatch.service.core import AlarmClass
from lumpwatch.service.protocol import COMMANDS, MESSAGES
from lumpwatch.service.storage import VerdictOutcome
from tests.cli.test_cli import Captured, done, failed

LARGE = ("numpy", "scipy", "numba", "cv2", "av", "rich", "pydantic", "zenoh", "docker", "prometheus_client")


def test_the_overview_has_every_command_once() -> None:
    listed = [name for group in GROUPS.values() for name in group]
    assert sorted(listed) == sorted(name for names in _MODULES.values() for name in names)


def test_the_help_imports_no_command(capsys: Captured) -> None:
    told = done(capsys, "--help")
    assert all(f"{title}:" in told for title in GROUPS)
    code = "import sys; from lumpwatch.service.cli import main; main(['--help']); print([m for m in "
    code += f"{LARGE} if m in sys.modules])"
    done_ = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done_.stdout.splitlines()[-1] == "[]"


def test_the_help_of_each_command_imports_nothing_large() -> None:
    """It took up to two seconds of processor time; what it costs is what it imports."""
    code = "import sys; from lumpwatch.service.cli import parser; parser(); print([m for m in "
    code += f"{LARGE} if m in sys.modules])"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert told.stdout == "[]\n", told.stderr


def test_what_the_arguments_say_by_name_is_what_there_is() -> None:
    """They are written down there, since what knows them takes long to import."""
    assert tuple(MESSAGES) == schema.MESSAGE_NAMES
    assert tuple(role.label for role in UserRole) == users.ROLES
    assert tuple(one.value for one in VerdictOutcome) == verdict.OUTCOMES
    assert tuple(one.value for one in AlarmClass) == operate.CLASSES


def test_what_operators_do_to_alarms_has_a_command_with_the_fields_of_its_request() -> None:
    rows = {
        row.name: row for row in COMMANDS.values() if row.action is not None and row.role is Role.OPERATOR
    }
    assert rows.keys() == {*_MODULES["arguments.operate"]}
    top = parser("ack")
    for name, row in rows.items():
        actions = {action.dest: action for action in of_command(top, name)._actions}
        fields = {field: info for field, info in row.request.model_fields.items() if field != "alarm_class"}
        assert fields.keys() == actions.keys() - {"help", "config", "camera", "roi", "alarm_class", "json"}
        for field in fields.keys() - {"actor"}:
            assert actions[field].required == fields[field].is_required(), (name, field)
            if get_origin(fields[field].annotation) is Literal:
                assert get_args(fields[field].annotation) == actions[field].choices


def test_a_command_that_there_is_not_gets_the_nearest_one(capsys: Captured) -> None:
    assert "did you mean replay?" in failed(capsys, "reply", code=2)
    assert "did you mean" not in failed(capsys, "qqq", code=2)
