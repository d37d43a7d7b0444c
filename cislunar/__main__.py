"""``python -m cislunar``: the command `cislunar`."""

from cislunar.command.main import cislunar

if __name__ == "__main__":
    cislunar(prog_name="cislunar")
