"""Users of the console in a file: names, roles, and passwords as scrypt hashes (RFC 7914).

{"version": 1, "users": {"anna": {"role": "operator", "scrypt": "15$<salt>$<hash>"}}}
"""

from __future__ import annotations

import hashlib
import hmac
import json
import re
import secrets
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from lumpwatch.service.config import UserRole
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import replace_file

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.@-]{0,63}")
_LOG_N, _R, _P = 15, 8, 1  # 32 MiB a hash
LEAST_LENGTH, MOST_LENGTH = 10, 200
"""Characters of a password."""
_MAX_BYTES = 1 << 20


class UsersError(LumpwatchError):
    """The file of users cannot be read or written, or a name or password is not accepted."""


@dataclass(frozen=True, slots=True)
class User:
    """Who acts."""

    name: str
    role: UserRole


class _Stored(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    role: Literal["viewer", "operator", "engineer"]
    scrypt: str = Field(pattern=r"^\d{1,2}\$[0-9a-f]{32}\$[0-9a-f]{64}$")


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    version: Literal[1]
    users: dict[str, _Stored]


class UserFile:
    """The users of a file, which is read again whenever it changes."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._seen: tuple[int, int, int] | None = None
        self._users: dict[str, _Stored] = {}

    def all(self) -> list[User]:
        """Everyone, by name. Raises UsersError."""
        return [User(name, UserRole.named(stored.role)) for name, stored in sorted(self._read().items())]

    def find(self, name: str) -> User | None:
        """The user of that name, as the file has it now. Raises UsersError."""
        stored = self._read().get(name)
        return User(name, UserRole.named(stored.role)) if stored else None

    def check(self, name: str, password: str) -> User | None:
        """The user, where the password is right; takes as long for a name that nobody has. Raises UsersError."""
        stored = self._read().get(name)
        right = _matches(password[:MOST_LENGTH], stored.scrypt if stored else _NOBODY)
        return User(name, UserRole.named(stored.role)) if stored and right else None

    def put(self, name: str, password: str, role: UserRole) -> None:
        """Add a user, or give one another password and role. Raises UsersError."""
        if not _NAME.fullmatch(name):
            raise UsersError(f"'{name[:64]}' cannot be a user's name: letters, digits, . _ @ -, at most 64")
        if not LEAST_LENGTH <= len(password) <= MOST_LENGTH:
            raise UsersError(f"a password has {LEAST_LENGTH} to {MOST_LENGTH} characters")
        users = self._read() if self.path.exists() else {}
        stored = _Stored.model_validate({"role": role.label, "scrypt": _hashed(password)})
        self._write({**users, name: stored})

    def set_role(self, name: str, role: UserRole) -> None:
        """Give a user another role. Raises UsersError."""
        users = self._read()
        if name not in users:
            raise UsersError(f"{self.path}: has no user {name[:64]}")
        self._write({**users, name: _Stored(role=role.label, scrypt=users[name].scrypt)})  # type: ignore[arg-type]

    def remove(self, name: str) -> None:
        """Remove a user. Raises UsersError."""
        users = dict(self._read())
        if users.pop(name, None) is None:
            raise UsersError(f"{self.path}: has no user {name[:64]}")
        self._write(users)

    def _read(self) -> dict[str, _Stored]:
        with self._lock:
            try:
                status = self.path.stat()
                seen = (status.st_mtime_ns, status.st_ino, status.st_size)
                if seen != self._seen:
                    if status.st_size > _MAX_BYTES:
                        raise UsersError(f"{self.path}: is too large for a file of users")
                    self._users = _File.model_validate_json(self.path.read_bytes()).users
                    self._seen = seen
            except OSError as error:
                raise UsersError(f"{self.path}: cannot be read ({error.strerror})") from error
            except ValidationError:
                raise UsersError(f"{self.path}: is not a file of `lumpwatch users`") from None
            return self._users

    def _write(self, users: dict[str, _Stored]) -> None:
        content = _File(version=1, users=dict(sorted(users.items()))).model_dump()
        try:
            replace_file(self.path, json.dumps(content, indent=1).encode() + b"\n", 0o600)
        except OSError as error:
            raise UsersError(f"{self.path}: cannot be written ({error.strerror})") from error


def _hashed(password: str) -> str:
    salt = secrets.token_bytes(16)
    return f"{_LOG_N}${salt.hex()}${_scrypt(password, salt, _LOG_N).hex()}"


def _matches(password: str, stored: str) -> bool:
    log_n, salt, expected = stored.split("$")
    found = _scrypt(password, bytes.fromhex(salt), min(int(log_n), 20))
    return hmac.compare_digest(found, bytes.fromhex(expected))


def _scrypt(password: str, salt: bytes, log_n: int) -> bytes:
    return hashlib.scrypt(
        password.encode("utf-8", "surrogatepass"),
        salt=salt,
        n=1 << log_n,
        r=_R,
        p=_P,
        maxmem=1 << 28,
        dklen=32,
    )


_NOBODY = f"{_LOG_N}${'00' * 16}${'00' * 32}"
"""Matches no password; hashing against it takes as long as against a real one."""
