"""How fast the environments are, beside other simulators in the same run: ``rodgym bench``.

* `rodgym.bench.measure`: interleaved, paired timing that survives a busy machine;
* `rodgym.bench.ours`, `rodgym.bench.peers`: what is timed;
* `rodgym.bench.precision`: error against cost of every stepper;
* `rodgym.bench.facts`: memory, time to make a batch, instruction sets, share of a training;
* `rodgym.bench.report`: tables and the plot.
"""
