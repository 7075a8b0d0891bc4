"""The results of checks as JUnit XML, which CI systems show."""

from xml.etree import ElementTree as ET

from hcbench._text import sanitized
from hcbench.check.outcome import Report, Verdict
from hcbench.check.text import outcome_text


def as_junit(report: Report) -> str:
    """One test suite, a test case a check. Times are left out: the same run gives the same bytes."""
    outcomes = report.outcomes
    failures = sum(o.verdict is Verdict.FAILED for o in outcomes)
    errors = sum(o.verdict in (Verdict.MISTAKE, Verdict.COULD_NOT_RUN) for o in outcomes)
    counts = {"tests": str(len(outcomes)), "failures": str(failures), "errors": str(errors)}
    suites = ET.Element("testsuites", counts)
    suite = ET.SubElement(suites, "testsuite", {"name": "hcbench", **counts})
    for outcome in outcomes:
        case = ET.SubElement(
            suite, "testcase", {"classname": "hcbench.check", "name": sanitized(outcome.name), "time": "0"}
        )
        if outcome.verdict is Verdict.FAILED:
            body = ET.SubElement(case, "failure", {"message": sanitized(outcome.message)})
        elif outcome.verdict in (Verdict.PASSED, Verdict.MEASURED):
            body = ET.SubElement(case, "system-out")
        else:
            body = ET.SubElement(
                case, "error", {"message": sanitized(outcome.message), "type": outcome.verdict.value}
            )
        body.text = outcome_text(outcome)
    ET.indent(suites)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(suites, encoding="unicode")}\n'
