"""Refusal of requested files that no rule makes."""

import os
import re
import sys

# A requested file that no rule makes is refused here with a message of one line. Snakemake knows the
# requested files only after reading this file, so the command line is read.
for option, asked in zip(sys.argv, sys.argv[1:]):
    if not re.search(r"^[^-=][^=]*[.](nc|csv|md|svg|png|pdf|html)$", asked) or os.path.exists(
        asked
    ):
        continue
    if option in ("--report", "--report-html-path", "--archive", "--directory", "-d"):
        continue
    try:
        check_request(
            asked,
            [str(output) for rule in workflow.rules for output in rule.output],
            KNOWN_WILDCARDS,
            any(rule.is_producer(asked) for rule in workflow.rules),
        )
    except CislunarError as error:
        raise SystemExit(f"error: {error}") from None
