"""Experiments that decide between designs of the diagnosis, on kept cases of the blind check.

    python -m benchmarks.experiments.truth_ladder     search, form or nominal numbers: what makes a case wrong
    python -m benchmarks.experiments.without_effect   the same cases' counterpart: best rivals where nothing is wrong
    python -m benchmarks.experiments.step_share       the share of the step's error as a coefficient that is fitted
    python -m benchmarks.experiments.bounds           nominal numbers bound at 2.5 deviations instead of 4
    python -m benchmarks.experiments.ensembles        spread of evidence over draws
    python -m benchmarks.experiments.steps            physics steps by stage, each measure alone

Cases may be named behind each. A case is ``SEED:NUMBER`` of ``tiago-mj blind --cases N --seed SEED``
(:mod:`.kept_cases` lists them); it is made again from its seed, so that nothing but the kept labels and answers is
needed. Only a few explanations of it are fitted (the nominal model, the truth, the answer that was given), never the
whole library: one to four minutes of a processor a case. Results go to ``benchmarks/results/experiments/NAME.json``
after every case; cases that are there are not run again. ``docs/blind-check.md`` says what came of them.
"""
