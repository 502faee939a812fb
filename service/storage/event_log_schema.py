"""The tables of an event log.

Events, verdicts and spans of uptime can be added and never changed. A row may be deleted when it lies
below the horizon that retention has set; the last event of an alarm never, since it is the alarm's state.
"""

from __future__ import annotations

VERSION = 2

_EVENTS = """
CREATE TABLE events (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    time_s REAL NOT NULL, monotonic_s REAL NOT NULL, clock TEXT NOT NULL,
    camera TEXT NOT NULL, roi TEXT NOT NULL, class TEXT NOT NULL,
    change TEXT NOT NULL, before TEXT NOT NULL, after TEXT NOT NULL,
    actor TEXT, reason TEXT, existence REAL NOT NULL, frame INTEGER NOT NULL,
    id TEXT NOT NULL, sequence INTEGER NOT NULL, alarm TEXT NOT NULL, details TEXT,
    UNIQUE (roi, id)
) STRICT;
CREATE INDEX events_of_alarm ON events (roi, class, number);
CREATE INDEX events_by_time ON events (time_s);
CREATE TRIGGER no_update BEFORE UPDATE ON events BEGIN SELECT RAISE(ABORT, 'append-only'); END;
CREATE TABLE outbox (roi TEXT NOT NULL, id TEXT NOT NULL, record BLOB NOT NULL, UNIQUE (roi, id)) STRICT;
"""
_NOTES = """
CREATE TABLE verdicts (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    time_s REAL NOT NULL, roi TEXT NOT NULL, id TEXT NOT NULL, sequence INTEGER NOT NULL,
    verdict TEXT NOT NULL, actor TEXT NOT NULL, note TEXT
) STRICT;
CREATE INDEX verdicts_of_alarm ON verdicts (roi, id, number);
CREATE TABLE watched (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    begin_s REAL NOT NULL, end_s REAL NOT NULL, roi TEXT NOT NULL, seen_s REAL NOT NULL, blind TEXT NOT NULL
) STRICT;
CREATE INDEX watched_by_time ON watched (end_s);
CREATE TABLE horizon (number INTEGER NOT NULL, time_s REAL NOT NULL) STRICT;
INSERT INTO horizon VALUES (0, 0);
CREATE TRIGGER no_delete BEFORE DELETE ON events
    WHEN OLD.number >= (SELECT number FROM horizon) OR NOT EXISTS
        (SELECT 1 FROM events WHERE roi = OLD.roi AND class = OLD.class AND number > OLD.number)
    BEGIN SELECT RAISE(ABORT, 'append-only'); END;
CREATE TRIGGER verdicts_no_update BEFORE UPDATE ON verdicts BEGIN SELECT RAISE(ABORT, 'append-only'); END;
CREATE TRIGGER verdicts_no_delete BEFORE DELETE ON verdicts
    WHEN EXISTS (SELECT 1 FROM events WHERE roi = OLD.roi AND id = OLD.id)
    BEGIN SELECT RAISE(ABORT, 'append-only'); END;
CREATE TRIGGER watched_no_update BEFORE UPDATE ON watched BEGIN SELECT RAISE(ABORT, 'append-only'); END;
CREATE TRIGGER watched_no_delete BEFORE DELETE ON watched
    WHEN OLD.end_s >= (SELECT time_s FROM horizon) BEGIN SELECT RAISE(ABORT, 'append-only'); END;
"""

SCHEMA = f"BEGIN; {_EVENTS} {_NOTES} PRAGMA user_version = {VERSION}; COMMIT;"
FROM_VERSION_1 = f"""BEGIN;
ALTER TABLE events ADD COLUMN details TEXT;
DROP TRIGGER no_delete;
{_NOTES}
PRAGMA user_version = {VERSION};
COMMIT;
"""
