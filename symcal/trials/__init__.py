"""`symcal study`: one experiment thousands of times, over a grid of what may differ, on all cores or on a cluster.

A trial is one repetition of one cell of the grid. What it draws comes from a stream of its own, and what it computes
does not depend on which trials are computed beside it: on the same CPU and kernels its numbers are the same bits for
any number of workers, in any order.

    schema (symcal.config.trials) -> load -> description -> worker: draw, identify, judge -> store -> statistics
                                                                                            -> export, figures, report
"""
