"""Writes monitoring/rules.yaml, the rules of `deploy/prometheus` for the Prometheus operator; the tests compare.

python -m deploy.kubernetes.make_rules
"""

from __future__ import annotations

from pathlib import Path

HERE = Path(__file__).parent
RULES = HERE.parent / "prometheus" / "rules"
TARGET = HERE / "monitoring" / "rules.yaml"
HEAD = """\
# Written by deploy/kubernetes/make_rules.py from deploy/prometheus/rules; edit those. For the Prometheus operator.
apiVersion: monitoring.coreos.com/v1
kind: PrometheusRule
metadata:
  name: lumpwatch
spec:
  groups:
"""


def text() -> str:
    """The object: the groups of all files, a step further in."""
    groups = [
        f"  {line}\n" if line else "\n"
        for file in sorted(RULES.glob("*.yml"))
        for line in file.read_text(encoding="utf-8").partition("groups:\n")[2].splitlines()
    ]
    return HEAD + "".join(groups)


if __name__ == "__main__":
    TARGET.write_text(text(), encoding="utf-8")
