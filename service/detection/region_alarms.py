"""The alarms of one region: the one that its channel steps, and those of blindness and trouble."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from lumpwatch.service.config import AlarmConfig, ConditionAlarmConfig
from lumpwatch.service.core import (
    Alarm,
    AlarmAction,
    AlarmChange,
    AlarmClass,
    Changed,
    Spells,
    Transition,
    Trouble,
    all_of,
    announce_again,
    step_alarm,
    tick_alarm,
)
from lumpwatch.service.detection.channel import Channel

_ROUNDING_S = 1e-6


class RegionAlarms:
    """Every method returns what became of the alarms, in order."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._others: dict[AlarmClass, Alarm] = {
            alarm_class: Alarm() for alarm_class in AlarmClass if alarm_class is not channel.alarm_class
        }
        self._blind = Spells()
        rules = channel.config.alarm.blind
        self._at_once = rules.model_copy(update={"on_delay_s": 0.0, "off_delay_s": 0.0})
        self._troubles: frozenset[Trouble] = frozenset()
        self._announced: frozenset[Trouble] = frozenset()
        """Those that the system alarm has been announced for."""

    def now(self) -> dict[AlarmClass, Alarm]:
        """All of them as they stand."""
        both = {self._channel.alarm_class: self._channel.alarm, **self._others}
        return {alarm_class: both[alarm_class] for alarm_class in AlarmClass}

    def restore(self, alarms: Mapping[AlarmClass, Alarm]) -> None:
        """Go on with these; others stay."""
        for alarm_class, alarm in alarms.items():
            self._put(alarm_class, alarm)

    def trouble(self, what: Trouble, *, present: bool) -> None:
        """Something keeps the region from judging as well as it must, or no longer does."""
        self._troubles = self._troubles | {what} if present else self._troubles - {what}

    def stepped(self, transition: Transition | None) -> tuple[AlarmChange, ...]:
        """The channel has stepped its alarm."""
        return self._changes(self._channel.alarm_class, all_of((self._channel.alarm, transition)))

    def apply(self, alarm_class: AlarmClass, action: AlarmAction, now_s: float) -> tuple[AlarmChange, ...]:
        """What an operator or the plant does to an alarm; raises what `action` raises."""
        return self._changes(alarm_class, action(self.now()[alarm_class], self._rules(alarm_class), now_s))

    def tick(self, blind_reason: str | None, now_s: float) -> tuple[AlarmChange, ...]:
        """Time goes by: whether the region is blind and why, its troubles, and holds that are over."""
        changes = self._step_blind(blind_reason, now_s) + self._step_system(now_s)
        for alarm_class in AlarmClass:
            ticked = tick_alarm(self.now()[alarm_class], self._rules(alarm_class), now_s)
            changes += self._changes(alarm_class, ticked)
        return changes

    def _step_blind(self, reason: str | None, now_s: float) -> tuple[AlarmChange, ...]:
        rules, before = self._channel.config.alarm.blind, self._others[AlarmClass.BLIND]
        self._blind = self._blind.step(now_s, holds=reason is not None, window_s=rules.summed_over_s)
        if before.active:
            sees_s = self._blind.free_for_s(now_s)
            blind = reason is not None or self._blind.many or sees_s < rules.off_delay_s - _ROUNDING_S
        else:
            total_s = self._blind.total_s(now_s, rules.summed_over_s)
            blind = reason is not None and total_s >= rules.on_delay_s - _ROUNDING_S
        alarm, transition = step_alarm(before, self._at_once, float(blind), now_s)
        if transition is not None and reason is not None:
            transition = replace(transition, reason=reason)
        return self._changes(AlarmClass.BLIND, all_of((alarm, transition)))

    def _step_system(self, now_s: float) -> tuple[AlarmChange, ...]:
        before, rules = self._others[AlarmClass.SYSTEM], self._rules(AlarmClass.SYSTEM)
        alarm, transition = step_alarm(before, rules, 1.0 if self._troubles else 0.0, now_s)
        new = self._troubles - self._announced
        if transition is None and alarm.active and new and self._announced:
            alarm, transition = announce_again(alarm, now_s)
        self._announced = self._troubles if alarm.active else frozenset()
        if transition is not None and self._troubles:
            transition = replace(transition, reason=", ".join(sorted(self._troubles)))
        return self._changes(AlarmClass.SYSTEM, all_of((alarm, transition)))

    def _rules(self, alarm_class: AlarmClass) -> AlarmConfig | ConditionAlarmConfig:
        return self._channel.config.alarm.of_class(alarm_class)

    def _put(self, alarm_class: AlarmClass, alarm: Alarm) -> None:
        if alarm_class is self._channel.alarm_class:
            self._channel.alarm = alarm
        else:
            self._others[alarm_class] = alarm

    def _changes(self, alarm_class: AlarmClass, changed: Changed) -> tuple[AlarmChange, ...]:
        """The alarm is another one now."""
        alarm, transitions = changed
        self._put(alarm_class, alarm)
        priority = self._rules(alarm_class).priority
        return tuple(AlarmChange(alarm_class, transition, alarm, priority) for transition in transitions)
