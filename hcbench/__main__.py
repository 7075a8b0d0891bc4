"""The command from its first instant on: until its modules are there, a signal ends it at once."""

# Built into the interpreter: the file of `signal` itself takes a while to read.
import _signal as signal  # type: ignore[import-not-found]
import gc
import os

_GARBAGE = 100_000  # objects until Python looks for some: imports make many and leave none


def _leave(number: int, frame: object) -> None:
    os.write(2, b"hcbench: interrupted; nothing was left half-written\n")
    os._exit(130)


def main() -> None:
    """Run the command line."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _leave)
    gc.set_threshold(_GARBAGE)
    from hcbench import cli

    cli.main()


if __name__ == "__main__":
    main()
