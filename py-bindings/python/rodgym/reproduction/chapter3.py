"""Chapter 3: thrust of rigid and flexible pitching fins, model against the thesis' experiments.

The thesis prints no tables of its measurements, so claims are compared, not curves. Rigid is the
same fin at 8e9 Pa; the thesis' fit is 8.11 MPa; soft is 0.25 MPa, where the model flexes visibly.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from rodgym.lab.fin_in_air import Experiment, fit_as_the_thesis
from rodgym.report.style import COLOURS, INK, styled
from rodgym.reproduction.fin_runs import (
    AMPLITUDES,
    FREQUENCIES,
    STEPS,
    Period,
    in_air,
    period,
    pitched,
)
from rodgym.reproduction.finding import Finding, write_findings
from rodgym.runs import Run, write_csv
from rodgym.sim import Fin

TITLE = "Chapter 3: thrust of rigid and flexible fins"
#: Young's modulus [Pa] of each fin.
FINS = {"rigid": 8e9, "thesis 8.11 MPa": 8.1112e6, "soft 0.25 MPa": 2.5e5, "soft 83 kPa": 8.3e4}
#: Noise of a synthetic measurement [m].
NOISE = 5e-4
Grid = Mapping[tuple[str, float, float], Period]


def reproduce(run: Run, progress: Callable[[str], None]) -> list[Finding]:
    """Computes everything into the run's folder; about a minute."""
    progress("stiffness along the fin")
    findings = [stiffness(run)]
    progress("response in air and the fit of E and zeta")
    findings += [air(run)]
    progress("thrust of four fins at 16 points")
    grid = {
        (name, a, f): period(a, f, youngs_modulus=e)
        for name, e in FINS.items()
        for a in AMPLITUDES
        for f in FREQUENCIES
    }
    findings += [thrust_maps(run, grid), gain(run, grid), phase(run, grid), coefficients(run, grid)]
    write_findings(run, TITLE, findings)
    return findings


def stiffness(run: Run) -> Finding:
    """Fig. 3.5: flexural stiffness along the fin, as meant and as Table 3.1 prints it."""
    geometry = Fin().config["geometry"]
    widths, height = np.array(geometry["widths"]), geometry["height"]
    x = np.arange(len(widths)) * geometry["edge_length"]
    meant = FINS["thesis 8.11 MPa"] * height * widths**3 / 12
    # (h w)^3 / 12 in mm^6, read as mm^4: a factor of 1e18 / 1e12.
    printed = FINS["thesis 8.11 MPa"] * (height * widths) ** 3 / 12 * 1e6
    rows = list(zip(x, widths, meant, printed, strict=True))
    write_csv(run.file("stiffness.csv"), ("x_m", "width_m", "EI_Nm2", "EI_as_printed_Nm2"), rows)
    inner = slice(1, -1)
    with styled():
        figure, axes = plt.subplots(figsize=(7, 3.6))
        axes.semilogy(1e3 * x[inner], meant[inner], "o-", color=COLOURS[0], label="I = h w³/12")
        axes.semilogy(1e3 * x[inner], printed[inner], "s--", color=COLOURS[1], label="I as printed")
        axes.set_xlabel("from the nose [mm]")
        axes.set_ylabel("E I [N m²] at 8.11 MPa")
        axes.set_title("Flexural stiffness along the fin")
        axes.legend()
        figure.savefig(run.file("stiffness.png"))
        plt.close(figure)
    return Finding(
        "Table 3.1, Fig. 3.5: flexural stiffness",
        "The fin's stiffness is compared with that of a sunfish.",
        f"E I falls from {meant[1]:.3f} to {meant[-2]:.4f} N m² towards the tail. The printed I is "
        f"(h w)³/12 in mm⁶; read as mm⁴ it would be {printed[1] / meant[1]:.0f} times stiffer.",
        "partly: the fin's curve is reproduced with I corrected; the sunfish's data are not in the "
        "text, so that the comparison itself cannot be repeated.",
        "stiffness.png",
    )


def air(run: Run) -> Finding:
    """Figs. 3.8 and 3.9: response in air, and the fit of E and zeta to synthetic data."""
    cases = [(a, f) for a in (6.0, 10.0) for f in (1.0, 2.0)]
    frames = 60
    noise = np.random.default_rng(3)
    rows, errors = [], []
    for truth in ((8.1112e6, 0.1238), (2.5e5, 0.1238)):
        measured = {
            (a, f): in_air(a, f, frames, youngs_modulus=truth[0], damping=truth[1])
            + noise.normal(0.0, NOISE, (frames, 8))
            for a in AMPLITUDES
            for f in FREQUENCIES
        }
        e, zeta, cost = fit({case: measured[case] for case in cases}, frames)
        rows.append((*truth, e, zeta, cost))
        for case, seen in measured.items():
            gap = seen - in_air(*case, frames, youngs_modulus=e, damping=zeta)
            errors.append((truth[0], *case, float(np.sqrt(np.mean(gap**2)))))
    header = ("true_E_Pa", "true_zeta_kg_s", "fitted_E_Pa", "fitted_zeta_kg_s", "cost_m")
    write_csv(run.file("fit.csv"), header, rows)
    write_csv(run.file("fit_errors.csv"), ("true_E_Pa", "A_deg", "f_Hz", "rms_m"), errors)
    # The tail of fins in air against the rigid tail: how much there is to be fitted.
    rigid = in_air(10.0, 1.5, frames, youngs_modulus=8e9)[:, -1]
    moduli = (8.1112e6, 1e6, 2.5e5, 1e5)
    tails = {m: in_air(10.0, 1.5, frames, youngs_modulus=m)[:, -1] for m in moduli}
    gaps = {m: 1e3 * float(np.abs(tail - rigid)[-40:].max()) for m, tail in tails.items()}
    t = np.arange(1, frames + 1) / 30
    columns = zip(t, rigid, *tails.values(), strict=True)
    write_csv(run.file("in_air.csv"), ("t_s", "rigid_m", *(f"{m:g}_Pa_m" for m in moduli)), columns)
    off = [abs(e / true - 1) for true, _, e, _, _ in rows]
    worst = 1e3 * max(error for *_, error in errors)
    with styled():
        figure, (above, below) = plt.subplots(
            2, 1, figsize=(7, 5.2), sharex=True, gridspec_kw={"height_ratios": [3, 2]}
        )
        # Dashed and on top: the stiffest fins' lines lie under it.
        for axes, values in ((above, 1e3 * rigid), (below, 0 * rigid)):
            axes.plot(t, values, color=INK, lw=1, ls=(0, (3, 3)), zorder=3, label="rigid")
        for (m, tail), colour in zip(tails.items(), COLOURS, strict=False):
            above.plot(t, 1e3 * tail, color=colour, label=f"{m / 1e6:.3g} MPa")
            below.plot(t, 1e3 * (tail - rigid), color=colour)
        above.set_ylabel("y of the tail [mm]")
        below.set_ylabel("less the rigid tail's [mm]")
        below.set_xlabel("t [s]")
        above.set_title("In air, 10 deg at 1.5 Hz")
        handles, labels = above.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5)
        figure.savefig(run.file("in_air.png"))
        plt.close(figure)
    return Finding(
        "3.4.1, Figs. 3.8, 3.9: in air, fit of E and zeta",
        "fminsearch finds E = 8.11 MPa, zeta = 0.1238; model and experiment agree very well.",
        "On synthetic data with 0.5 mm noise at 30 Hz the same routine finds "
        + ", ".join(
            f"{e / 1e6:.3g} MPa where {true / 1e6:.3g} is true" for true, _, e, _, _ in rows
        )
        + ". The tail differs from a rigid one by "
        + ", ".join(f"{gaps[m]:.2f} mm at {m / 1e6:.3g} MPa" for m in moduli)
        + f". RMS error of the fitted models over 4-10 deg and 0.5-2 Hz: at most {worst:.2f} mm.",
        f"partly: the routine finds a soft fin's E to {100 * off[1]:.0f} %, but cannot tell a "
        "stiff fin from a rigid one: at these frequencies it hardly bends in air, so a good fit "
        "says little about E.",
        "in_air.png",
    )


def fit(measured: Mapping[tuple[float, float], np.ndarray], frames: int) -> tuple[float, ...]:
    """E [Pa], zeta [kg/s] and cost (thesis 3.1) [m] of the fin that moves most like that."""
    experiments = [Experiment(seen, pitched(*case, frames)) for case, seen in measured.items()]
    found, cost = fit_as_the_thesis(experiments)
    return found["youngs_modulus"], found["damping"], cost


def thrust_maps(run: Run, grid: Grid) -> Finding:
    """Figs. 3.10 and 3.12: mean thrust over amplitude and frequency."""
    rows = [
        (
            *(name, a, f, p.mean_thrust, p.efficiency, p.strouhal, p.thrust_coefficient),
            *p.second_harmonic,
        )
        for (name, a, f), p in grid.items()
    ]
    header = ("fin", "A_deg", "f_Hz", "thrust_N", "efficiency", "strouhal", "C_T")
    write_csv(run.file("thrust.csv"), (*header, "thrust_2f_N", "peak_phase_deg"), rows)
    with styled():
        figure, panels = plt.subplots(1, len(FINS), figsize=(13, 3.4), sharey=True)
        for axes, name in zip(panels, FINS, strict=True):
            values = np.array(
                [[1e3 * grid[name, a, f].mean_thrust for f in FREQUENCIES] for a in AMPLITUDES]
            )
            heatmap(axes, values, f"{name}: thrust [mN]", "viridis", 200.0)
        panels[0].set_ylabel("A [deg]")
        figure.savefig(run.file("thrust.png"))
        plt.close(figure)
    top = {}
    for name in FINS:
        points = [(grid[name, a, f].mean_thrust, a, f) for a in AMPLITUDES for f in FREQUENCIES]
        top[name] = max(points)
    grows = all(
        np.all(np.diff([grid[n, a, f].mean_thrust for a in AMPLITUDES]) > 0)
        for n in FINS
        for f in FREQUENCIES
    ) and all(
        np.all(np.diff([grid[n, a, f].mean_thrust for f in FREQUENCIES]) > 0)
        for n in FINS
        for a in AMPLITUDES
    )
    return Finding(
        "Figs. 3.10, 3.12: thrust over amplitude and frequency",
        "Higher thrust at higher frequencies and amplitudes (abstract); the largest measured "
        "thrust is at 10 deg and 1.5 Hz (captions).",
        "; ".join(
            f"{n}: largest at {a:g} deg, {f:g} Hz, {1e3 * t:.1f} mN" for n, (t, a, f) in top.items()
        )
        + ".",
        (
            "partly: thrust grows with amplitude and with frequency everywhere"
            if grows
            else "differs: thrust does not grow with amplitude and frequency everywhere"
        )
        + ", but so its largest is at 2 Hz, not 1.5 Hz.",
        "thrust.png",
    )


def heatmap(axes: Axes, values: np.ndarray, title: str, colours: str, top: float) -> None:
    """Numbers over frequency and amplitude, coloured up to `top`."""
    axes.imshow(values, origin="lower", cmap=colours, aspect="auto", vmin=0, vmax=top)
    axes.grid(False)
    for i, j in np.ndindex(values.shape):
        ink = "black" if values[i, j] > 0.6 * top else "white"
        digits = 0 if abs(values[i, j]) >= 99.95 else 1
        # Adding 0 turns a rounded -0.0 into 0.0.
        number = f"{round(values[i, j], digits) + 0.0:.{digits}f}"
        text = "rigid: drag" if np.isnan(values[i, j]) else number
        ink = INK if np.isnan(values[i, j]) else ink
        axes.text(j, i, text, ha="center", va="center", color=ink)
    axes.set_xticks(range(len(FREQUENCIES)), [f"{f:g}" for f in FREQUENCIES])
    axes.set_yticks(range(len(AMPLITUDES)), [f"{a:g}" for a in AMPLITUDES])
    axes.set_xlabel("f [Hz]")
    axes.set_title(title)


def gain(run: Run, grid: Grid) -> Finding:
    """Fig. 3.14: percent gain of the flexible fin over the rigid one."""
    soft = [name for name in FINS if name != "rigid"]

    def percent(name: str, a: float, f: float) -> float:
        rigid = grid["rigid", a, f].mean_thrust
        # Of a drag there is no percentage.
        return 100 * (grid[name, a, f].mean_thrust / rigid - 1) if rigid > 0 else float("nan")

    rows = [(n, a, f, percent(n, a, f)) for n in soft for a in AMPLITUDES for f in FREQUENCIES]
    write_csv(run.file("gain.csv"), ("fin", "A_deg", "f_Hz", "gain_percent"), rows)
    with styled():
        figure, panels = plt.subplots(1, len(soft), figsize=(10.4, 3.4), sharey=True)
        for axes, name in zip(panels, soft, strict=True):
            values = np.array([[percent(name, a, f) for f in FREQUENCIES] for a in AMPLITUDES])
            heatmap(axes, values, f"{name}: gain [%]", "cividis", 400.0)
        panels[0].set_ylabel("A [deg]")
        figure.savefig(run.file("gain.png"))
        plt.close(figure)
    ends = [
        f"{n}: {percent(n, 10.0, 0.5):+.0f} % at 0.5 Hz, {percent(n, 10.0, 2.0):+.0f} % at 2 Hz"
        for n in soft
    ]
    drag = 1e3 * grid["rigid", 4.0, 0.5].mean_thrust
    low = f"At 4 deg and 0.5 Hz the rigid fin's thrust is {drag:.2f} mN."
    return Finding(
        "Fig. 3.14: gain of the flexible fin",
        "A flexible fin gives more mean thrust than a rigid one; the gain is largest at low "
        "frequencies, where the rigid fin has nearly no thrust.",
        "At 10 deg " + "; ".join(ends) + ". " + low,
        "partly: the flexible fins do give more thrust wherever the rigid one has any to speak of, "
        "but the model's gain grows with f until the wet bending mode is passed. At 4 deg and "
        "0.5 Hz the rigid fin has a small drag, so that a percentage means nothing.",
        "gain.png",
    )


def phase(run: Run, grid: Grid) -> Finding:
    """Figs. 3.11 and 3.13: thrust over the drive's phase at 1.5 Hz."""
    degrees = 360 * np.arange(1, STEPS + 1) / STEPS
    runs = [(n, a) for n in FINS for a in AMPLITUDES]
    columns = zip(degrees, *(grid[n, a, 1.5].thrust for n, a in runs), strict=True)
    header = ("phase_deg", *(f"{n} {a:g} deg" for n, a in runs))
    write_csv(run.file("phase.csv"), header, columns)
    with styled():
        figure, panels = plt.subplots(1, len(FINS), figsize=(13, 3.8), sharex=True)
        for axes, name in zip(panels, FINS, strict=True):
            for a, colour in zip(AMPLITUDES, COLOURS, strict=False):
                axes.plot(
                    degrees, 1e3 * grid[name, a, 1.5].thrust, color=colour, label=f"{a:g} deg"
                )
            peak = grid[name, 10.0, 1.5].second_harmonic[1]
            for at in (peak, peak + 180):
                axes.axvline(at, color=INK, lw=1, ls=(0, (4, 3)))
            axes.annotate(
                f" peak {peak:.0f}°", (peak, 1.0), xycoords=("data", "axes fraction"), va="top"
            )
            axes.margins(y=0.14)
            axes.set_xticks(range(0, 361, 90))
            axes.set_xlabel("drive phase [deg]")
            axes.set_title(name)
        panels[0].set_ylabel("thrust [mN] at 1.5 Hz")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
        figure.savefig(run.file("phase.png"))
        plt.close(figure)
    peaks = {n: grid[n, 10.0, 1.5].second_harmonic for n in FINS}
    calm = [n for n, (a, p) in peaks.items() if a < peaks["rigid"][0] and abs(p - 180) < 20]
    return Finding(
        "Figs. 3.11, 3.13: thrust over the drive's phase",
        "Thrust oscillates at twice the drive's frequency; the model peaks at 90 and 270 deg, the "
        "experiment at 0 and 180; the flexible fin oscillates less than the rigid one.",
        "; ".join(
            f"{n}: peak at {p:.0f} deg, amplitude {1e3 * a:.1f} mN" for n, (a, p) in peaks.items()
        )
        + ".",
        ("partly" if 90 <= peaks["rigid"][1] <= 120 else "differs")
        + ": twice the drive's frequency, and the rigid model's peak near 90 deg (a sin term moves "
        "it past), agree, with the thesis' signs corrected. Neither the experiment's peak near 180 "
        "deg nor its smaller oscillation is there at the thesis' stiffness; both are at: "
        + (", ".join(calm) or "none of these")
        + ".",
        "phase.png",
    )


def coefficients(run: Run, grid: Grid) -> Finding:
    """Fig. 3.15: thrust coefficient over Strouhal number."""
    with styled():
        figure, axes = plt.subplots(figsize=(7, 3.6))
        rows = []
        for name, colour in zip(FINS, COLOURS, strict=False):
            points = [grid[name, a, f] for a in AMPLITUDES for f in FREQUENCIES]
            st, ct = [p.strouhal for p in points], [p.thrust_coefficient for p in points]
            axes.plot(st, ct, "o", color=colour, label=name, markersize=4)
            rows += [(name, s, c) for s, c in zip(st, ct, strict=True)]
        axes.set_xlabel("Strouhal number f W / U")
        axes.set_ylabel("thrust coefficient C_T")
        axes.set_title("Thrust coefficient over Strouhal number")
        axes.legend()
        figure.savefig(run.file("coefficients.png"))
        plt.close(figure)
    write_csv(run.file("coefficients.csv"), ("fin", "strouhal", "C_T"), rows)

    def at_equal_strouhal(name: str) -> float:
        """Mean ratio to the rigid fin's C_T, interpolated at the same St, where both have it."""
        rigid = sorted((s, c) for n, s, c in rows if n == "rigid")
        ratios = [
            c / np.interp(s, *np.array(rigid).T)
            for n, s, c in rows
            if n == name and 0.3 < s < rigid[-1][0]
        ]
        return float(np.mean(ratios))

    ratios = {n: at_equal_strouhal(n) for n in FINS if n != "rigid"}
    higher = [n for n, r in ratios.items() if r > 1.02]
    return Finding(
        "Fig. 3.15: C_T over St",
        "Thrust grows with St; at equal St the flexible fin gives more thrust.",
        "C_T over the rigid fin's at equal St (0.3 and above): "
        + ", ".join(f"{n} {r:.2f}" for n, r in ratios.items())
        + ".",
        "partly: C_T grows with St; at equal St "
        + (
            f"more thrust for {', '.join(higher)}."
            if higher
            else "no flexible fin gives more: flexing acts through St."
        ),
        "coefficients.png",
    )
