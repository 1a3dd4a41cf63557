import io
from pathlib import Path
from types import SimpleNamespace

import pytest

from lookdev.run import events
from lookdev.run.progress import Tally, show_progress

STORY: tuple[events.Event, ...] = (
    events.Noted("city: 3 negative texels repaired"),
    events.RunStarted(total=5, pending=3),
    events.FrameStarted("gold/city/element.0001"),
    events.FrameProgressed("gold/city/element.0001", 8, 64, None),
    events.FrameProgressed("gold/city/element.0001", 64, 64, 2.5e-4),
    events.FrameDone("gold/city/element.0001", 40.0, 64, 2.5e-4),
    events.FrameStarted("gold/city/element.0002"),
    events.FrameRetried("gold/city/element.0002", "died [of SIGKILL]", 2, 3),
    events.FrameFailed("gold/city/element.0002", "died [of SIGKILL]"),
    events.FrameStarted("gold/city/element.0003"),
    events.FrameDone("gold/city/element.0003", 20.0, 64, 1e-3),
    events.SheetWritten(Path("out/element.sheet.png")),
)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class LogFile(io.StringIO):
    """Counts the characters that are flushed."""

    flushed = 0

    def flush(self) -> None:
        self.flushed = len(self.getvalue())


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return the seconds on the clock, which the test sets."""
    seconds = [100.0]
    monkeypatch.setattr("lookdev.run.progress.time", SimpleNamespace(monotonic=lambda: seconds[0]))
    return seconds


def test_a_log_file_gets_plain_lines_at_once(clock: list[float]) -> None:
    log = LogFile()
    with show_progress(log) as report:
        for event in STORY:
            clock[0] += event.seconds if isinstance(event, events.FrameDone) else 0.0
            report(event)
            assert log.flushed == len(log.getvalue())
    assert log.getvalue().splitlines() == [
        "note: city: 3 negative texels repaired",
        "5 frames, 3 to render",
        "[3/5] gold/city/element.0001  40.0 s  64 samples  relMSE 2.5e-04  left 0:01:20",
        "retry 2/3 gold/city/element.0002: died [of SIGKILL]",
        "[4/5] gold/city/element.0002  FAILED: died [of SIGKILL]",
        "[5/5] gold/city/element.0003  20.0 s  64 samples  relMSE 1.0e-03",
        "sheet out/element.sheet.png",
    ]


@pytest.mark.parametrize("kind", [Terminal, LogFile])
def test_no_name_controls_the_terminal(monkeypatch: pytest.MonkeyPatch, kind: type[io.StringIO]) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    stream, name = kind(), "gold\x1b[5m\x9b\u202e/city"
    with show_progress(stream) as report:
        report(events.Noted(f"{name}: noted"))
        report(events.FrameStarted(name))
        report(events.FrameFailed(name, f"the worker said {name}"))
    assert "gold?[5m??/city" in stream.getvalue()
    assert "\x1b[5m" not in stream.getvalue()
    assert not {"\x9b", "\u202e"} & set(stream.getvalue())


def test_a_terminal_gets_one_live_display(monkeypatch: pytest.MonkeyPatch, clock: list[float]) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "120")
    terminal = Terminal()
    with show_progress(terminal) as report:
        for event in STORY[:-2]:
            clock[0] += event.seconds if isinstance(event, events.FrameDone) else 0.0
            report(event)
        report(events.FrameProgressed("gold/city/element.0003", 16, 64, 3e-3))
    output = terminal.getvalue()
    assert "\x1b[?25l" in output  # the display hides the cursor
    assert "\x1b[?25h" in output
    last = output.rpartition("\x1b[2K")[2]
    assert "gold/city/element.0003" in last
    assert "16/64 samples  relMSE 3.0e-03" in last
    assert "4/5  left 0:00:20" in output
    assert "died [of SIGKILL]" in output  # brackets are text, not markup


def test_time_left_is_that_since_the_start_for_each_frame_times_those_waiting(clock: list[float]) -> None:
    tally, left = Tally(), []
    tally.count(events.RunStarted(total=10, pending=4))
    assert tally.time_left() == ""
    # Two at once, of 15 s each: they overlap.
    for seconds, event in (
        (10.0, events.FrameDone("a", 15.0, 64, 0.0)),
        (2.0, events.FrameFailed("b", "reason")),
        (12.0, events.FrameDone("c", 15.0, 64, 0.0)),
        (1.0, events.FrameDone("d", 15.0, 64, 0.0)),
    ):
        clock[0] += seconds
        tally.count(event)
        left.append(tally.time_left())
    assert left == ["0:00:30", "0:00:12", "0:00:08", ""]
