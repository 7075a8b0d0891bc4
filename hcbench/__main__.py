"""The command from its first instant on: until its modules are there, a signal ends it at once."""

# Built into the interpreter: the file of `signal` itself takes a while to read.
import _signal as signal  # type: ignore[import-not-found]
import gc
import os

# MB of addresses that NumPy, an engine and their buffers take at least.
_LEAST_MB = 480
_GARBAGE = 200_000  # objects until Python looks for some: imports make many and leave none


def _leave(number: int, frame: object) -> None:
    os.write(2, b"hcbench: interrupted; nothing was left half-written\n")
    os._exit(130)


def _require_memory() -> None:
    """End the process with exit code 3 where a limit leaves it too little memory to import what it
    needs: NumPy's OpenBLAS would end it with a code of its own, or try again without end.
    """
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < _LEAST_MB << 20:
        got = f"limited to {limit >> 20} MB of addresses"
        advice = "`ulimit -v` sets the limit"
        os.write(2, f"hcbench: memory: {got}; expected {_LEAST_MB} MB or more. {advice}\n".encode())
        os._exit(3)


def main() -> None:
    """Run the command line."""
    _require_memory()
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _leave)
    gc.set_threshold(_GARBAGE)
    # Before NumPy is imported: its matrices are small here, and threads would wait for one another
    # in loops, in each of the worker processes, too.
    if "OMP_NUM_THREADS" not in os.environ:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Pydantic would read the entry points of all packages here, for plug-ins of its own.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    from hcbench import cli

    cli.main()


if __name__ == "__main__":
    main()
