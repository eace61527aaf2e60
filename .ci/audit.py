"""Known weaknesses of the packages in requirements.lock, by pip-audit and the OSV database; run by ``make audit``.

Exit code 0: none is known, or the database cannot be reached in time, which is said. Exit code 1: some are known.
"""

import subprocess
import sys

TIME = 60.0
"""Most that installing pip-audit, and asking it, may take each [s]."""
PIP = (
    sys.executable,
    "-m",
    "pip",
    "install",
    "--quiet",
    "--disable-pip-version-check",
    "--retries",
    "1",
    "pip-audit>=2.7",
)
AUDIT = (
    sys.executable, "-m", "pip_audit", "--requirement", "requirements.lock", "--no-deps", "--disable-pip",
    "--vulnerability-service", "osv", "--timeout", "10", "--progress-spinner", "off",
)  # fmt: skip
UNREACHABLE = ("ConnectionError", "ConnectTimeout", "ServiceError", "Could not connect", "Max retries", "timed out")
"""Words by which pip-audit says that the database does not answer."""


def main() -> int:
    """Run the audit and return its exit code."""
    for command, need in ((PIP, "pip-audit cannot be installed"), (AUDIT, "the database does not answer")):
        try:
            result = subprocess.run(command, capture_output=True, text=True, timeout=TIME, check=False)
        except subprocess.TimeoutExpired:
            return _skipped(f"{need} within {TIME:.0f} s")
        if command is PIP and result.returncode:
            return _skipped(need)
    if result.returncode and any(word in result.stderr for word in UNREACHABLE):
        return _skipped(need)
    print(result.stdout + result.stderr, end="", flush=True)
    return result.returncode


def _skipped(reason: str) -> int:
    print(f"audit: skipped, {reason}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
