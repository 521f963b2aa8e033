"""What the checks found: a line each, and the sum."""
import time


class Failure(Exception):
    """What a check finds wrong, in a line."""


def expect(condition, text):
    if not condition:
        raise Failure(text)


class Report:
    def __init__(self):
        self.passed = self.failed = 0
        self.start = time.monotonic()

    def note(self, text):
        print(f"     {text}", flush=True)

    def run(self, name, check, *arguments):
        """Run a check: it returns what it measured, or raises. True: it passed."""
        start = time.monotonic()
        try:
            detail, word = check(*arguments), "ok"
            self.passed += 1
        except Exception as fault:  # whatever it is, the other checks go on
            detail, word = f"{fault}" or type(fault).__name__, "FAIL"
            self.failed += 1
        spent = time.monotonic() - start
        print(f"{word:4} {name}: {detail} [{spent:.0f} s]", flush=True)
        return word == "ok"

    def sum_up(self):
        spent = time.monotonic() - self.start
        print(f"vmtest: {self.passed} passed, {self.failed} failed in {spent:.0f} s", flush=True)
        return 0 if self.failed == 0 and self.passed > 0 else 1
