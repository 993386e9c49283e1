"""How fast the environments are, beside other simulators in the same run: ``rodgym bench``.

* :mod:`rodgym.bench.measure`: interleaved, paired timing that survives a busy machine;
* :mod:`rodgym.bench.ours`, :mod:`rodgym.bench.peers`: what is timed;
* :mod:`rodgym.bench.precision`: error against cost of every stepper;
* :mod:`rodgym.bench.facts`: memory, time to make a batch, instruction sets, share of a training;
* :mod:`rodgym.bench.report`: tables and the plot.
"""
