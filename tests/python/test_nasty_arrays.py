"""Promise: whatever is given for an array, the native module works or raises an error of ours; no
panic of Rust, no error of somebody else's, no endless loop, no warning. Every function of the
module that Python can call catches panics.
"""

from __future__ import annotations

import inspect
import itertools
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rodgym
from conftest import SWING_UP
from rodgym import _native, errors

SOURCES = Path(__file__).parents[2] / "py-bindings" / "src"
EYE = np.eye(2)
#: Parameters of two environments.
OWN: list[dict[str, float]] = [{}, {}]
FIN = "rodgym/FinThrust-v0"


def read_only() -> np.ndarray:
    array = np.zeros((2, 18), dtype=np.float32)
    array.flags.writeable = False
    return array


class Angry:
    """An object that answers nothing."""

    def __getattr__(self, name: str) -> Any:
        raise RuntimeError(name)

    def __repr__(self) -> str:
        raise RuntimeError("no repr")

    def __len__(self) -> int:
        raise RuntimeError("no length")


NASTY: dict[str, Any] = {
    **{f"zeros{shape}": np.zeros(shape) for shape in [0, (0, 0), (2, 0), (0, 2), (1, 0, 2)]},
    "scalar": np.float64(1.0),
    "no dimension": np.array(1.0),
    "one dimension": np.ones(2),
    "three dimensions": np.ones((2, 2, 2)),
    "many dimensions": np.ones((1,) * 32),
    "(3, 3)": np.ones((3, 3)),
    **{
        f"full of {x}": np.full((2, 2), x)
        for x in (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e200, 5e-324, 0.0, -0.0)
    },
    "a NaN": np.array([[1.0, np.nan], [0.0, 1.0]]),
    "negative": -EYE,
    "strided": np.eye(4)[::2, ::2],
    "backwards": EYE[::-1, ::-1],
    "by columns": np.asfortranarray(np.ones((2, 2))),
    "broadcast": np.broadcast_to(1.0, (2, 2)),
    "read-only": read_only(),
    "unaligned": np.frombuffer(b"\0" * 33, dtype=np.uint8)[1:].view(np.float64).reshape(2, 2),
    "objects": np.array([[1, None], [2, 3]], dtype=object),
    "numbers as objects": EYE.astype(object),
    "complex": EYE * 1j,
    "bool": np.eye(2, dtype=bool),
    "text": np.array([["a", "b"], ["c", "d"]]),
    "big-endian": EYE.astype(">f8"),
    "half": EYE.astype(np.float16),
    "long": EYE.astype(np.longdouble),
    "bytes": EYE.astype(np.int8),
    "unsigned": np.full((2, 2), 2**64 - 1, dtype=np.uint64),
    "records": np.zeros((2, 2), dtype=[("a", "f8")]),
    "dates": np.zeros((2, 2), dtype="M8[s]"),
    "None": None,
    "a string": "abc",
    "ragged": [[1.0], [1.0, 2.0]],
    "nested": [[[[[[[[[[[[[[[[[[[[1.0]]]]]]]]]]]]]]]]]]]],
    "a dictionary": {},
    "a set": {1.0},
    "a range": range(2),
    "a type": float,
    "angry": Angry(),
}


def fresh() -> dict[str, Callable[[Any], Any]]:
    """Calls with one place for an array each, by name; the first word is the native name."""
    batch = _native.Batch(SWING_UP, 2)
    batch.reset(0)
    single = _native.Batch(SWING_UP, 1, {}, "Single")
    single.reset_single(0)
    bare = _native.Simulation("pendulum", {"nodes": 2})
    fin = _native.Simulation("fin", {})
    lqr = _native.Controller("lqr", batch.spec)
    base = _native.Batch("rodgym/PendulumSwingUpBase-v0", 1)
    learner = _native.Controller("lqg-adaptive", base.spec)
    seen, known = np.zeros((2, 18), np.float32), np.zeros((2, lqr.state_size))
    still, flags = np.zeros((2, 1), np.float32), np.ones(2, dtype=bool)
    scene, gallery = batch.scene(0), _native.Gallery()

    def squares(target: Any, state: Any, last: Any) -> _native.Search:
        return _native.Search(batch, 0, 20, np.zeros(5), quadratic=(target, state, 1.0, last))

    def riccati(solve: Callable[..., Any], place: int, array: Any) -> Any:
        matrices: list[Any] = [EYE * 0.5, EYE, EYE, EYE, EYE * 0.0]
        matrices[place] = array
        return solve(*matrices)

    calls: dict[str, Callable[[Any], Any]] = {
        f"{solve.__name__} {name}": lambda x, s=solve, i=i: riccati(s, i, x)
        for solve in (_native.care, _native.dare)
        for i, name in enumerate("ABQRN")
    }
    calls |= {
        f"{solve.__name__} all": lambda x, s=solve: s(x, x, x, x, x)
        for solve in (_native.care, _native.dare)
    }
    geometry = ("widths", "areas", "edge_length", "height", "pivot")
    return calls | {
        "Batch.step actions": batch.step,
        "Batch.step out": lambda x: batch.step(still, x),
        "Batch.reset seeds": batch.reset,
        "Batch.reset mask": lambda x: batch.reset(0, x),
        "Batch.reset options": lambda x: batch.reset(0, None, x),
        "Batch.reset parameters": lambda x: batch.reset(0, None, {"parameters": x}),
        "Batch.reset width": lambda x: batch.reset(0, None, {"parameters": {"width": x}}),
        "Batch.reset state": lambda x: batch.reset(0, None, {"state": x}),
        "Batch.reset angles": lambda x: batch.reset(0, None, {"state": {"angles": x, "rates": x}}),
        "Batch.reset positions": lambda x: batch.reset(
            0, None, {"state": {"positions": x, "velocities": x}}
        ),
        "Batch.reset out": lambda x: batch.reset(0, None, None, x),
        "Batch.step_single action": single.step_single,
        "Batch.reset_single seed": single.reset_single,
        "Batch.reset_single options": lambda x: single.reset_single(0, x),
        "Batch.configure parameters": lambda x: batch.configure(0, 2, {"width": x}, {}),
        "Batch.configure randomize": lambda x: batch.configure(0, 2, {}, {"width": x}),
        "Batch.step_jacobian action": lambda x: single.step_jacobian(0, x, []),
        "Batch.step_jacobian parameters": lambda x: single.step_jacobian(0, [0.0], x),
        "Batch.step_jacobians actions": lambda x: single.step_jacobians(x, []),
        "Batch.step_jacobians parameters": lambda x: single.step_jacobians([[0.0]], x),
        "Batch.rollout_gradients actions": lambda x: single.rollout_gradients(x, []),
        "Batch.rollout_gradients parameters": lambda x: single.rollout_gradients([[[0.0]]], x),
        "Batch.rollout_gradient actions": lambda x: single.rollout_gradient(0, x, []),
        "Batch.set_state state": lambda x: batch.set_state(0, x),
        "Batch.__setstate__ states": batch.__setstate__,
        "Batch.__setstate__ state": lambda x: batch.__setstate__([x]),
        "Batch profile": lambda x: _native.Batch(FIN, 1, {"stiffness_profile": x}),
        "Batch range": lambda x: _native.Batch(FIN, 1, {"randomize": {"damping": x}}),
        "Batch ranges": lambda x: _native.Batch(FIN, 1, {"randomize": x}),
        "Batch noise": lambda x: _native.Batch(FIN, 1, {"sensor_noise": x}),
        "Batch geometry": lambda x: _native.Batch(FIN, 1, {"geometry": x}),
        **{
            f"Batch {name}": lambda x, n=name: _native.Batch(FIN, 1, {"geometry": {n: x}})
            for name in geometry
        },
        "Simulation profile": lambda x: _native.Simulation("fin", {"stiffness_profile": x}),
        "Simulation.set_state both": lambda x: bare.set_state(x, x),
        "Simulation.set_state velocities": lambda x: bare.set_state(EYE * 0.0, x),
        "Simulation.set_vector x": bare.set_vector,
        "Simulation.jacobian parameters": lambda x: bare.jacobian(0.0, 1, x),
        "Simulation.ask linearize": lambda x: bare.ask("linearize", x),
        "Simulation.ask torque": lambda x: bare.ask("linearize", [x]),
        "Simulation.act set_angles": lambda x: bare.act("set_angles", x),
        "Simulation.act angles": lambda x: bare.act("set_angles", [x, x]),
        "Simulation.act step_feedback": lambda x: bare.act("step_feedback", x, 3),
        "Simulation.act drive": lambda x: fin.act("drive", [x], 3),
        "Simulation.__setstate__ state": bare.__setstate__,
        "Simulation.__setstate__ numbers": lambda x: bare.__setstate__((x, 0)),
        "Search actions": lambda x: _native.Search(batch, 0, 20, x),
        "Search target": lambda x: squares(x, np.ones(24), np.zeros(24)),
        "Search state": lambda x: squares(np.zeros(24), x, np.zeros(24)),
        "Search last": lambda x: squares(np.zeros(24), np.ones(24), x),
        "Controller spec": lambda x: _native.Controller("lqr", {**batch.spec, "action": x}),
        "Controller.load data": _native.Controller.load,
        "Controller.predict observation": lambda x: lqr.predict(x, known, flags),
        "Controller.predict state": lambda x: lqr.predict(seen, x, flags),
        "Controller.predict episode_start": lambda x: lqr.predict(seen, known, x),
        "Controller.estimate state": learner.estimate,
        "info_list terms": lambda x: _native.info_list(["a"], ["b"], x, OWN, flags, flags),
        "info_list limit": lambda x: _native.info_list(["a"], ["b"], EYE, OWN, x, flags),
        "info_list failed": lambda x: _native.info_list(["a"], ["b"], EYE, OWN, flags, x),
        "analyse rod": _native.analyse,
        "analyse width": lambda x: _native.analyse({"width": x}),
        "plain_values given": _native.plain_values,
        "plain_values width": lambda x: _native.plain_values({"width": x}),
        "upright rod": _native.upright,
        "upright nodes": lambda x: _native.upright({"nodes": x}),
        "thesis_run rod": _native.thesis_run,
        "thesis_run width": lambda x: _native.thesis_run({"width": x}, duration=0.01),
        **{
            f"Gallery.{draw} {name}": lambda x, n=name, d=draw: getattr(gallery, d)(
                0, {**scene, n: x}
            )
            for draw in ("render", "svg")
            for name in ("nodes", "thickness", "curvature", "action", "values", "arrows")
        },
        "Gallery.svg force": lambda x: gallery.svg(0, {**scene, "arrows": {"fluid_force": x}}),
    }


CALLS = fresh()


@pytest.mark.parametrize("call", CALLS)
def test_nasty_arrays_work_or_are_refused_by_our_errors(call):
    refused = 0
    for name, array in NASTY.items():
        try:
            CALLS[call](array)
        except rodgym.RodgymError as error:  # noqa: PERF203
            refused += 1
            assert "fault of rodgym" not in str(error), name
            assert len(str(error)) < 2000, name
        except BaseException as error:
            pytest.fail(f"{call} of {name}: {error!r}")
    # (Nothing takes all of them.)
    assert refused > 5


def takes_arrays() -> Iterator[str]:
    """Native names with an argument that is or holds arrays, by the stub."""
    stub = Path(_native.__file__).with_name("_native.pyi").read_text()
    arrays = re.compile(r"_Flag|_Float|_Single|ArrayLike|list\[|dict\[|Mapping|: bytes|tuple\[")
    outer = ""
    for head in re.findall(r"^(?:class \w+:|(?:    )?def \w+\([^)]*\))", stub, re.M):
        if head.startswith("class"):
            outer = head[6:-1] + "."
            continue
        if not head.startswith(" "):
            outer = ""
        if arrays.search(head.partition("(")[2]):
            name = re.sub(r"\(.*", "", head.strip(), flags=re.S).removeprefix("def ")
            yield (outer + name).removesuffix(".__new__")


def test_the_sweep_reaches_every_function_that_takes_arrays():
    reached = {name.split()[0] for name in CALLS}
    # The server's words are strings.
    assert set(takes_arrays()) - reached == {"serve"}


def test_care_and_dare_refuse_what_has_no_states_or_inputs():
    """The first panicked."""
    empty = np.zeros((0, 0))
    for solve in (_native.care, _native.dare):
        with pytest.raises(errors.ShapeError, match=r"B has shape \(0, 0\).*at least one state"):
            solve(empty, empty, empty, empty)
        with pytest.raises(errors.ShapeError, match=r"B has shape \(2, 0\)"):
            solve(EYE, np.zeros((2, 0)), EYE, empty)


def test_complex_matrices_are_refused_and_not_cut():
    """Their imaginary parts were dropped."""
    for solve in (_native.care, _native.dare):
        with pytest.raises(errors.ShapeError, match="Q must be an array of numbers"):
            solve(EYE, EYE, EYE * (1 + 1j), EYE)
    with pytest.raises(errors.ShapeError, match="positions must be an array of numbers"):
        rodgym.sim.Pendulum(nodes=2).set_state(EYE * 1j)


def test_huge_and_tiny_matrices_end():
    """Balancing went on for ever where a square overflows."""
    huge, tiny = EYE * 1e200, EYE * 1e-200
    for solve in (_native.care, _native.dare):
        for a in (huge, -huge, tiny, EYE * 1e308, EYE * 5e-324, np.full((2, 2), 1e308)):
            with np.errstate(all="raise"), pytest.raises(errors.DesignError) as refused:
                solve(a, EYE * 1e160, EYE, EYE)
                raise errors.DesignError("it has a solution")
            assert str(refused.value)


def test_units_of_a_matrix_do_not_matter_to_its_solution():
    """Time in other units: A and B times c, P and K by hand."""
    one = np.ones((1, 1))
    for c in (1e-120, 1.0, 1e120):
        cost, gain = _native.care(one * c, one * c, one, one)
        np.testing.assert_allclose(gain, 1.0 + np.sqrt(2.0), rtol=1e-9)
        np.testing.assert_allclose(cost * c, 1.0 + np.sqrt(2.0), rtol=1e-9)


def test_results_go_into_arrays_that_can_take_them():
    batch = _native.Batch(SWING_UP, 2)
    batch.reset(0)
    before = batch.get_states(0, 2)
    still = np.zeros((2, 1), np.float32)
    wide = np.zeros((2, 36), np.float32)
    for out in (read_only(), wide[:, ::2], np.zeros((2, 17), np.float32), np.zeros((2, 18))):
        with pytest.raises(errors.ShapeError, match="out must be a float32 array of shape"):
            batch.step(still, out)
        assert batch.get_states(0, 2) == before
    # An action may lie in the memory of the results.
    out = np.zeros((2, 18), np.float32)
    alone = _native.Batch(SWING_UP, 2)
    alone.reset(0)
    assert batch.step(out[:, :1], out)[0] is out
    assert alone.step(still)[0].tobytes() == out.tobytes()


def test_infos_have_a_name_for_every_number():
    flags = np.ones(2, dtype=bool)
    with pytest.raises(errors.ShapeError, match=r"terms has shape \[2, 2\], but \[2, 3\]"):
        _native.info_list(["a"], ["b", "c"], EYE, OWN, flags, flags)
    with pytest.raises(errors.ShapeError, match=r"limit has shape \[3\], but \[2\]"):
        _native.info_list(["a"], ["b"], EYE, OWN, np.ones(3, dtype=bool), flags)


def test_every_function_catches_panics():
    """What catches them is tested in `py-bindings/caught` and `env-core/src/fault.rs`."""
    found = 0
    for source in sorted(SOURCES.glob("*.rs")):
        lines = source.read_text("utf-8").splitlines()
        for before, line in itertools.pairwise(lines):
            if re.match(r"#\[py(methods|function)", line):
                found += 1
                assert before == "#[caught]", f"{source.name}: {line}"
    assert found > 10
    functions = [f for f in vars(_native).values() if inspect.isbuiltin(f)]
    assert len(functions) > 8
