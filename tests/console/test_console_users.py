from __future__ import annotations

import stat
from pathlib import Path

import pytest

from lumpwatch.service.cli import main
from lumpwatch.service.config import ConsoleConfig, UserRole
from lumpwatch.service.console import UserFile, UsersError
from lumpwatch.service.console.sessions import Sessions, Throttle
from lumpwatch.service.console.users import User


class Clock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_a_password_is_kept_as_a_hash_that_only_its_owner_reads(tmp_path: Path) -> None:
    file = UserFile(tmp_path / "users.json")
    file.put("anna", "correct horse", UserRole.OPERATOR)
    file.put("boris", "correct horse", UserRole.VIEWER)
    content = file.path.read_text()
    assert "correct" not in content
    hashes = [line for line in content.splitlines() if "scrypt" in line]
    assert hashes[0] != hashes[1], "the same password shows by its hash"
    assert stat.S_IMODE(file.path.stat().st_mode) == 0o600
    assert file.check("anna", "correct horse") == User("anna", UserRole.OPERATOR)
    assert file.check("anna", "correct horsf") is None
    assert file.check("nobody", "correct horse") is None


def test_changes_by_another_process_count_at_once(tmp_path: Path) -> None:
    here, there = UserFile(tmp_path / "users.json"), UserFile(tmp_path / "users.json")
    here.put("anna", "correct horse", UserRole.OPERATOR)
    there.set_role("anna", UserRole.ENGINEER)
    assert here.find("anna") == User("anna", UserRole.ENGINEER)
    there.remove("anna")
    assert here.find("anna") is None


@pytest.mark.parametrize(
    ("name", "password"),
    [
        ("", "correct horse"),
        ("../x", "correct horse"),
        ("<b>", "correct horse"),
        ("anna", "short"),
        ("anna", "x" * 201),
    ],
)
def test_names_and_passwords_are_bounded(tmp_path: Path, name: str, password: str) -> None:
    with pytest.raises(UsersError):
        UserFile(tmp_path / "users.json").put(name, password, UserRole.VIEWER)


@pytest.mark.parametrize(
    "content", ["", "[]", '{"version": 2, "users": {}}', '{"version": 1, "users": {"a": 1}}']
)
def test_a_damaged_file_lets_nobody_in(tmp_path: Path, content: str) -> None:
    (tmp_path / "users.json").write_text(content)
    with pytest.raises(UsersError, match=r"users\.json"):
        UserFile(tmp_path / "users.json").check("anna", "correct horse")


def test_the_command_adds_lists_and_removes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import io

    config = tmp_path / "site.yaml"
    config.write_text(
        "site: pit\nconsole: {users: users.json}\ncameras:\n  - {id: c, source: {url: a.mp4}, rois: "
        "[{id: r, polygon: [[0, 0], [1, 0], [1, 1]]}]}\n"
    )
    monkeypatch.setattr("sys.stdin", io.StringIO("correct horse\n"))
    assert main(["users", "add", str(config), "anna", "--role", "operator"]) == 0
    assert main(["users", "list", str(config)]) == 0
    assert capsys.readouterr().out == "anna  operator\n"
    assert UserFile(tmp_path / "users.json").check("anna", "correct horse") is not None
    assert main(["users", "remove", str(config), "anna"]) == 0
    assert main(["users", "remove", str(config), "anna"]) == 1
    assert main(["users", "add", str(config), "anna"]) == 2


def test_a_session_ends(tmp_path: Path) -> None:
    clock = Clock()
    sessions = Sessions(60.0, clock)
    session = sessions.begin(User("anna", UserRole.OPERATOR))
    assert sessions.find(session.token) == session
    clock.now_s = 60.0
    assert sessions.find(session.token) is None
    assert sessions.find(None) is None


def test_callers_without_a_login_log_nobody_out() -> None:
    sessions = Sessions(60.0, Clock())
    session = sessions.begin(User("anna", UserRole.OPERATOR))
    for _ in range(1100):
        sessions.begin(None)
    assert sessions.find(session.token) == session


def test_tries_after_five_failures_wait_ever_longer() -> None:
    clock = Clock()
    throttle = Throttle(clock)
    for _ in range(5):
        assert throttle.wait_s("anna", "here") == 0.0
        throttle.failed("anna", "here")
    assert throttle.wait_s("anna", "elsewhere") == 1.0
    clock.now_s = 1.0
    throttle.failed("anna", "here")
    assert throttle.wait_s("boris", "here") == 2.0
    throttle.succeeded("anna", "here")
    assert throttle.wait_s("anna", "here") == 0.0


@pytest.mark.parametrize(
    "given",
    [
        {"listen": "0.0.0.0:8080"},
        {"listen": "0.0.0.0:8080", "users": "u.json"},
        {"listen": "192.0.2.1:8080", "anonymous": "viewer", "users": "u.json", "allow_http": True},
        {"listen": "8080"},
    ],
)
def test_what_others_reach_must_be_closed(given: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"listen|address|host:port"):
        ConsoleConfig.model_validate(given)


def test_who_has_not_logged_in_sees_on_loopback_alone() -> None:
    assert ConsoleConfig().visitor is UserRole.VIEWER
    assert ConsoleConfig(users=Path("u.json")).visitor is None
    assert ConsoleConfig(anonymous="engineer").visitor is UserRole.ENGINEER
