"""Real recordings whose truth is known, and what anybody's diagnosis says of them.

    python -m benchmarks.real cases
    python -m benchmarks.real fetch-list
    python -m benchmarks.real convert CASE OUT --data DIR
    python -m benchmarks.real run OUT --data DIR
    python -m benchmarks.real baseline regression OUT --data DIR
    python -m benchmarks.real submit ANSWERS.json
    python -m benchmarks.real table

``declare`` says what a case is; each module of ``robots`` has one robot's readers, nominal models, regressions and
cases; ``logs`` writes recordings, ``score`` judges answers, ``baselines`` are what a diagnosis must beat. No recording
is part of the repository: the user fetches them.
"""
