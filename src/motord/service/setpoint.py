"""The set-point that the supervisor writes to the mailbox, and the state requests that go with it.

A request (enable, disable, stop, reset) is carried out once, when its number changes, and the loop
reads the mailbox once a tick. So one request at a time is written, the next not before a tick
confirms the one before.
"""

from collections import deque
from math import inf

import numpy as np

from motord.api.messages import SetpointView
from motord.control.types import SETPOINT
from motord.schema import Compensate, Request
from motord.sequencing import NOTHING_INDUCED
from motord.sequencing.settings import COMPENSATE
from motord.shm.mailbox import MailboxWriter

RAD_PER_TURN = 2 * np.pi
_WITHOUT_ATTRIBUTES = np.dtype((np.void, SETPOINT))
"""Written a hundred times a second: attributes of a record take twice as long."""
UNSEEN_NS = 200_000_000
"""A request that no tick confirms within this time is followed by the next."""


class Setpoint:
    """Torque, speed, brake, drive and compensation; torque and drive begin at zero."""

    def __init__(self, mailbox: MailboxWriter) -> None:
        self._mailbox = mailbox
        self._record = np.zeros(1, SETPOINT)
        self._fields: np.void = self._record.view(_WITHOUT_ATTRIBUTES)[0]
        self._requests: deque[Request] = deque()
        self.newest_request = Request.NONE
        self.requested = 0
        """How many requests there were so far: tells who waits whether another came after."""
        self._requested_ns = -inf  # when the newest was written, unless nothing waits for it
        self._request_seq_at = 0  # number of the set-point that brought the newest request
        self.torque_Nm = 0.0
        self.speed_Hz: float | None = None
        self.brake = 0.0
        self.drive_Hz = 0.0
        self.compensate = Compensate(0)
        self.brake_temperature_C = float("nan")
        self.channels_beyond = 0
        self.i2t_derating = 0.0
        self.plan_point = -1
        self.induced = self._written_induced = NOTHING_INDUCED  # all zero, as the record begins

    def request(self, request: Request) -> int:
        """Queue `request`, and return its number. A stop replaces all others."""
        if request is Request.STOP:
            self._requests.clear()
            self._requested_ns = -inf
        self._requests.append(request)
        self.newest_request = request
        self.requested += 1
        return self.requested

    def rest(self) -> None:
        """No torque, an open brake and a standing drive."""
        self.torque_Nm, self.speed_Hz, self.brake, self.drive_Hz = 0.0, None, 0.0, 0.0
        self.plan_point = -1
        self.induced = NOTHING_INDUCED

    def write(self, now_ns: int, seen_seq: int) -> None:
        """Write the mailbox, which adds the time as the supervisor's heartbeat.

        `now_ns`: monotonic; `seen_seq`: number of the set-point that the newest tick used.
        """
        s = self._fields
        s["seq"] = (int(s["seq"]) + 1) & 0xFFFFFFFF
        if self._requests and self._confirmed(now_ns, seen_seq):
            s["request"] = int(self._requests.popleft())
            s["request_seq"] = (int(s["request_seq"]) + 1) & 0xFFFFFFFF
            self._requested_ns, self._request_seq_at = now_ns, int(s["seq"])
        s["torque_Nm"] = self.torque_Nm
        s["speed_rad_s"] = (self.speed_Hz or 0.0) * RAD_PER_TURN
        s["brake"] = self.brake
        s["brake_temperature_C"] = self.brake_temperature_C
        s["channels_beyond"] = self.channels_beyond
        s["i2t_derating"] = self.i2t_derating
        s["drive_rad_s"] = self.drive_Hz * RAD_PER_TURN
        s["plan_point"] = self.plan_point
        s["compensate"] = int(self.compensate)
        if self.induced is not self._written_induced:  # seldom, and arrays take long to write
            self._written_induced = self.induced
            s["induced_gain"] = [gain - 1.0 for gain in self.induced.gain]
            s["induced_offset_A"] = self.induced.offset_A
            s["induced_cogging"] = self.induced.cogging - 1.0
        self._mailbox.write(self._record)

    def _confirmed(self, now_ns: int, seen_seq: int) -> bool:
        behind = (seen_seq - self._request_seq_at) & 0xFFFFFFFF
        return behind < 0x80000000 or now_ns - self._requested_ns > UNSEEN_NS

    def view(self, torque_target_Nm: float | None = None) -> SetpointView:
        """Return the set-point as published; the torque may be on its way to `torque_target_Nm`."""
        return SetpointView(
            torque_Nm=self.torque_Nm,
            torque_target_Nm=self.torque_Nm if torque_target_Nm is None else torque_target_Nm,
            speed_Hz=self.speed_Hz,
            brake=self.brake,
            drive_Hz=self.drive_Hz,
            compensate=next(n for n, flags in COMPENSATE.items() if flags == self.compensate),
        )
