//! Programs in C, compiled against the header, take the same bits as Rust does, and are refused in words.

use rodgym_baselines::registry::{Target, make};
use rodgym_baselines::saved;
use rodgym_core::catalog::{self, MakeOptions};
use rodgym_core::env::{AutoresetMode, ResetOptions, Seeds, StepBuffer, VectorEnv};
use serde_json::{Value, json};
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const HERE: &str = env!("CARGO_MANIFEST_DIR");

/// Where cargo puts what it builds for this test, the library for C among it.
fn built() -> PathBuf {
    std::env::current_exe().unwrap().parent().unwrap().to_owned()
}

/// Compiles a program, with every warning an error.
fn compiled(name: &str, source: &Path) -> PathBuf {
    let folder = built().join("from_c");
    fs::create_dir_all(&folder).unwrap();
    let program = folder.join(name);
    let mut cc = Command::new(std::env::var("CC").unwrap_or_else(|_| "cc".into()));
    cc.args(["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1"]);
    cc.arg(format!("-I{HERE}/include")).arg(source);
    cc.arg(built().join("librodgym_controllers.a"));
    cc.args(["-lpthread", "-ldl", "-lm", "-o"]).arg(&program);
    let made = cc.output().expect("a C compiler, `cc`, is there");
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    program
}

fn environment(id: &str, kwargs: &Value) -> Box<dyn VectorEnv> {
    catalog::make(&MakeOptions {
        id: id.into(),
        num_envs: 1,
        kwargs: kwargs.as_object().unwrap().clone(),
        autoreset_mode: AutoresetMode::Disabled,
        max_episode_steps: None,
        num_threads: 1,
    })
    .unwrap()
}

/// An environment's target, and the observations of an episode under a controller, with its actions and its last state as the
/// bits that `play.c` writes.
fn episode(name: &str, id: &str, kwargs: Value, steps: usize) -> (Vec<u8>, Vec<u8>, String) {
    let mut env = environment(id, &kwargs);
    let target = Target::from(env.spec());
    let law = make(name, &target).unwrap();
    let mut out = StepBuffer::new(env.spec(), 1);
    env.reset(&Seeds::Each(vec![Some(7)]), None, &ResetOptions::default(), out.data()).unwrap();
    let (mut state, mut action) = (vec![0.0; law.state_size()], vec![0.0; law.action_size()]);
    let (mut seen, mut wanted) = (Vec::new(), String::new());
    for step in 0..steps {
        if step % 10 == 9 && law.takes_lost_samples() {
            out.observation.fill(f32::NAN);
        }
        seen.extend(out.observation.iter().flat_map(|x| x.to_le_bytes()));
        law.predict(&out.observation, &mut state, &[step == 0], &mut action).unwrap();
        wanted.extend(action.iter().map(|x| format!("{:08x}\n", x.to_bits())));
        env.step(&action, out.data()).unwrap();
    }
    wanted.extend(state.iter().map(|x| format!("{:016x}\n", x.to_bits())));
    (saved::encode(name, &target, &*law).unwrap(), seen, wanted)
}

#[test]
fn every_controller_takes_the_same_bits_in_c() {
    let program = compiled("play", &Path::new(HERE).join("tests/play.c"));
    let base = "rodgym/PendulumSwingUpBase-v0";
    let full = "rodgym/PendulumSwingUp-v0";
    let fin = "rodgym/FinThrust-v0";
    let noise = json!({"angle": 1e-3, "rate": 1e-2});
    for (name, id, kwargs) in [
        ("lqr", full, json!({"nodes": 13})),
        ("lqr-hybrid", full, json!({})),
        ("lqg", base, json!({"sensor_noise": noise, "actuator_delay": 0.015})),
        ("lqg-adaptive", base, json!({"sensor_noise": noise, "youngs_modulus": 8e6})),
        ("thesis-lqr", full, json!({})),
        ("thesis-lqg", base, json!({})),
        ("gait-sine", fin, json!({"youngs_modulus": 2.5e5})),
    ] {
        let (bytes, seen, wanted) = episode(name, id, kwargs, 150);
        let folder = program.parent().unwrap();
        let (law, observations) =
            (folder.join(format!("{name}.rodlaw")), folder.join(format!("{name}.f32")));
        fs::write(&law, bytes).unwrap();
        fs::write(&observations, seen).unwrap();
        let played = Command::new(&program).args([law, observations]).output().unwrap();
        assert!(played.status.success(), "{name}: {}", String::from_utf8_lossy(&played.stderr));
        assert!(String::from_utf8(played.stdout).unwrap() == wanted, "{name}");
    }
}

#[test]
fn what_is_refused_in_c_has_a_code_and_words() {
    let program = compiled("border", &Path::new(HERE).join("tests/border.c"));
    let checked = Command::new(program).output().unwrap();
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
}

#[test]
fn the_page_s_program_swings_a_rod_up() {
    let page = fs::read_to_string(format!("{HERE}/../docs/motor.md")).unwrap();
    let source = page.split("```c\n").nth(1).and_then(|rest| rest.split("```").next()).unwrap();
    let folder = built().join("from_c");
    fs::create_dir_all(&folder).unwrap();
    let file = folder.join("swing.c");
    fs::write(&file, source).unwrap();
    let program = compiled("swing", &file);

    let kwargs = json!({"youngs_modulus": 8e6, "actuator_delay": 0.01});
    let (bytes, ..) = episode("lqg-adaptive", "rodgym/PendulumSwingUpBase-v0", kwargs.clone(), 0);
    let law = folder.join("swing.rodlaw");
    fs::write(&law, bytes).unwrap();
    // The rod at the other end of two pipes.
    let mut swing = Command::new(&program)
        .arg(&law)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut env = environment("rodgym/PendulumSwingUpBase-v0", &kwargs);
    let mut out = StepBuffer::new(env.spec(), 1);
    env.reset(&Seeds::Each(vec![Some(3)]), None, &ResetOptions::default(), out.data()).unwrap();
    let mut encoder = swing.stdin.take().unwrap();
    let mut motor = BufReader::new(swing.stdout.take().unwrap()).lines();
    for _ in 0..500 {
        let [cos, sin, rate] = out.observation[..] else { unreachable!("the base alone") };
        let (angle, rate) = (libm::atan2f(sin, cos), 10.0 * rate);
        writeln!(encoder, "{angle} {rate}").unwrap();
        let torque: f32 = motor.next().unwrap().unwrap().parse().unwrap();
        env.step(&[torque / 0.05], out.data()).unwrap();
    }
    drop(encoder);
    assert!(out.observation[0] < -0.99, "upright: the cosine is {}", out.observation[0]);
    let told = String::from_utf8(swing.wait_with_output().unwrap().stderr).unwrap();
    assert!(told.contains("youngs_modulus") && told.contains("Pa"), "{told}");
}
