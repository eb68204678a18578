"""Interrupt a piece of code at each of its instructions in turn."""

import gc
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any


def interrupted(
    work: Callable[[], object], instruction: int, interrupt: Callable[[], object], folder: str = ""
) -> bool:
    """Run `work`, and `interrupt` at one of its instructions; False if it has fewer.

    Only code counts whose path contains `folder`. At which instructions Python calls the handler of a signal
    depends on its version; here all are tried.
    """
    passed = 0

    def trace(frame: FrameType, event: str, _: object) -> Any:
        nonlocal passed
        if folder not in frame.f_code.co_filename:
            return None
        frame.f_trace_opcodes = True
        if event == "opcode":
            passed += 1
            if passed == instruction:
                sys.settrace(None)
                interrupt()
        return trace

    gc.disable()  # it calls code of others, which ignores exceptions
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(None)
        gc.enable()
    return passed >= instruction
