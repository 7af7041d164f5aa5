"""`python -m jaxdem`, the same as the command `jaxdem`."""

from jaxdem.cli import process


def main() -> None:
    """Entry point of the console script: the process first, so that a signal while the rest is loaded is handled."""

    def commands() -> None:
        from jaxdem.cli.main import app

        app(prog_name="jaxdem")

    process.run(commands)


if __name__ == "__main__":
    main()
