//! The backward sweep: from models of dynamics and losses to changes of actions and feedback.

/// What stands for a control step near a trajectory, in changes z of n numbers of state and u of the action:
/// the next z is A z + B u, the loss changes by q z + r u + (z'Qz + 2 u s z + R u u) / 2.
#[derive(Clone, Debug, Default)]
pub struct Model {
    /// A, n rows.
    pub a: Vec<f64>,
    /// B.
    pub b: Vec<f64>,
    /// q.
    pub q: Vec<f64>,
    /// r.
    pub r: f64,
    /// Q, n rows, symmetric.
    pub qq: Vec<f64>,
    /// s.
    pub s: Vec<f64>,
    /// R.
    pub rr: f64,
}

/// What comes of a sweep: in step t the action's change is `alpha change[t] + feedback[t] z`, within the bounds.
#[derive(Clone, Debug, Default)]
pub struct Policy {
    /// A step each.
    pub change: Vec<f64>,
    /// n numbers a step.
    pub feedback: Vec<f64>,
    /// How much less loss the models promise: to first order in alpha, and to second.
    pub promise: [f64; 2],
}

impl Policy {
    /// The loss that the models promise to take away for a part `alpha` of the changes.
    pub fn promised(&self, alpha: f64) -> f64 {
        -alpha * (self.promise[0] + alpha * self.promise[1])
    }
}

/// Solves the models backwards. Actions are within [-1, 1]; `damping` is added to the curvature by each action; the loss
/// after the last step is 0.
pub fn sweep(models: &[Model], actions: &[f64], damping: f64, out: &mut Policy) {
    let (steps, n) = (models.len(), models.first().map_or(0, |model| model.b.len()));
    out.change.clear();
    out.change.resize(steps, 0.0);
    out.feedback.clear();
    out.feedback.resize(steps * n, 0.0);
    out.promise = [0.0; 2];
    // Slope and curvature of the loss to come.
    let (mut v, mut vv) = (vec![0.0; n], vec![0.0; n * n]);
    let (mut by_z, mut by_zz) = (vec![0.0; n], vec![0.0; n * n]);
    let (mut ahead, mut ahead_b, mut mixed) = (vec![0.0; n * n], vec![0.0; n], vec![0.0; n]);
    for t in (0..steps).rev() {
        let Model { a, b, q, r, qq, s, rr } = &models[t];
        // V A and V B.
        ahead.fill(0.0);
        for i in 0..n {
            let row = &mut ahead[i * n..(i + 1) * n];
            for k in 0..n {
                add(row, vv[i * n + k], &a[k * n..(k + 1) * n]);
            }
            ahead_b[i] = dot(&vv[i * n..(i + 1) * n], b);
        }
        by_z.copy_from_slice(q);
        by_zz.copy_from_slice(qq);
        mixed.copy_from_slice(s);
        for k in 0..n {
            add(&mut by_z, v[k], &a[k * n..(k + 1) * n]);
            add(&mut mixed, ahead_b[k], &a[k * n..(k + 1) * n]);
        }
        // A'(V A), the lower half.
        for k in 0..n {
            let (row, ahead) = (&a[k * n..(k + 1) * n], &ahead[k * n..(k + 1) * n]);
            for i in 0..n {
                add(&mut by_zz[i * n..i * n + i + 1], row[i], &ahead[..=i]);
            }
        }
        let slope = r + dot(b, &v);
        let curvature = rr + dot(b, &ahead_b);
        let damped = (curvature + damping).max(f64::MIN_POSITIVE);
        let wanted = actions[t] - slope / damped;
        let bounded = wanted.clamp(-1.0, 1.0);
        let change = bounded - actions[t];
        out.change[t] = change;
        out.promise[0] += change * slope;
        out.promise[1] += 0.5 * change * change * curvature;
        let gains = &mut out.feedback[t * n..(t + 1) * n];
        // An action at its bound answers nothing.
        if wanted == bounded {
            for (gain, mixed) in gains.iter_mut().zip(&mixed) {
                *gain = -mixed / damped;
            }
        }
        let pull = slope + curvature * change;
        for i in 0..n {
            v[i] = by_z[i] + gains[i] * pull + mixed[i] * change;
            let twice = curvature * gains[i] + mixed[i];
            for j in 0..=i {
                let value = by_zz[i * n + j] + twice * gains[j] + gains[i] * mixed[j];
                vv[i * n + j] = value;
                vv[j * n + i] = value;
            }
        }
    }
}

#[inline(always)]
fn add(to: &mut [f64], factor: f64, from: &[f64]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += factor * from;
    }
}

#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    //! One sweep of a linear-quadratic problem is its solution.

    use super::*;
    use crate::linalg::dare;
    use nalgebra::DMatrix;

    /// A weight on a spring that is pushed, and its losses.
    fn spring() -> Model {
        Model {
            a: vec![1.0, 0.1, -0.2, 0.97],
            b: vec![0.005, 0.1],
            q: vec![0.0; 2],
            r: 0.0,
            qq: vec![1.0, 0.0, 0.0, 0.1],
            s: vec![0.0; 2],
            rr: 0.5,
        }
    }

    #[test]
    fn gains_far_from_the_end_are_those_of_the_riccati_equation() {
        let model = spring();
        let mut policy = Policy::default();
        sweep(&vec![model.clone(); 400], &[0.0; 400], 0.0, &mut policy);
        let matrix =
            |numbers: &[f64], rows, columns| DMatrix::from_row_slice(rows, columns, numbers);
        let solution = dare(
            &matrix(&model.a, 2, 2),
            &matrix(&model.b, 2, 1),
            &matrix(&model.qq, 2, 2),
            &matrix(&[model.rr], 1, 1),
            None,
        )
        .unwrap();
        for i in 0..2 {
            assert!((policy.feedback[i] + solution.gain[(0, i)]).abs() < 1e-12);
        }
        assert!(policy.change.iter().all(|change| *change == 0.0));
    }

    #[test]
    fn what_is_promised_is_kept_where_the_models_are_exact_and_bounds_are_kept_everywhere() {
        // About a trajectory with actions of 0.3 and a state of (2, -1) at its start.
        let model = spring();
        let (steps, start) = (30, [2.0, -1.0]);
        let step = |x: [f64; 2], u: f64| {
            let a = &model.a;
            [a[0] * x[0] + a[1] * x[1] + model.b[0] * u, a[2] * x[0] + a[3] * x[1] + model.b[1] * u]
        };
        let loss = |x: [f64; 2], u: f64| 0.5 * (x[0] * x[0] + 0.1 * x[1] * x[1] + 0.5 * u * u);
        for (narrow, alpha) in [(false, 1.0), (false, 0.4), (true, 1.0)] {
            // Small motions stay far from the bounds, large ones reach them.
            let scale: f64 = if narrow { 20.0 } else { 0.05 };
            let at = |x: [f64; 2], u: f64| Model {
                q: vec![x[0], 0.1 * x[1]],
                r: 0.5 * u,
                ..model.clone()
            };
            let given = vec![0.3 * scale.min(1.0); steps];
            let (mut xs, mut models, mut before) = (vec![start.map(|x| scale * x)], vec![], 0.0);
            for &u in &given {
                let x = xs[xs.len() - 1];
                models.push(at(x, u));
                before += loss(x, u);
                xs.push(step(x, u));
            }
            let mut policy = Policy::default();
            sweep(&models, &given, 0.0, &mut policy);
            let (mut x, mut after, mut largest) = (xs[0], 0.0, 0.0_f64);
            for t in 0..steps {
                let z = [x[0] - xs[t][0], x[1] - xs[t][1]];
                let gains = &policy.feedback[2 * t..2 * t + 2];
                let u = given[t] + alpha * policy.change[t] + gains[0] * z[0] + gains[1] * z[1];
                let u = u.clamp(-1.0, 1.0);
                largest = largest.max(u.abs());
                after += loss(x, u);
                x = step(x, u);
            }
            assert_eq!(largest == 1.0, narrow);
            if narrow {
                assert!(after < before);
            } else {
                let promised = policy.promised(alpha);
                assert!((before - after - promised).abs() < 1e-12 * before, "{promised}");
            }
        }
    }
}
