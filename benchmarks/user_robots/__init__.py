"""Small robots of nobody in particular, recorded by an independent simulation, and what the diagnosis says of them.

    python -m benchmarks.user_robots --models two_joint,lift --truths none,friction --seeds 3 --out DIR

``models`` are the robots, as a newcomer writes them; ``record`` is the reality that they are recorded in, with the
truths of ``truths``; ``case`` runs the command line on one set of recordings and judges the answer. ``models``,
``truths`` and ``record`` import nothing of ``tiago_mj.gap``.
"""
