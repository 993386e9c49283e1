//! Keys on disk: our own pair, and the users who may come in.
//!
//! A key directory holds `public.key` (to give away), `secret.key` (0600) and, for a server,
//! `authorized/NAME.key`: users' public keys with optional limits. Files are lines `word = value`.

use crate::limits::UserLimits;
use std::collections::HashMap;
use std::fs;
use std::io::Write;
use std::path::Path;

/// A CURVE key pair in Z85, 40 characters each.
#[derive(Clone)]
pub struct KeyPair {
    /// To give away.
    pub public: String,
    /// To keep.
    pub secret: String,
}

/// A user who may come in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct User {
    /// Public key in Z85.
    pub public: String,
    /// Limits of this user.
    pub limits: UserLimits,
}

/// Writes a new key pair into `directory`, and an empty `authorized` beside it.
///
/// # Errors
/// Keys that exist already, or a directory that cannot be written: a sentence.
pub fn generate(directory: &Path) -> Result<KeyPair, String> {
    let pair = zmq::CurveKeyPair::new().map_err(|e| format!("no key pair could be made: {e}"))?;
    let text = |bytes: &[u8]| zmq::z85_encode(bytes).map_err(|e| e.to_string());
    let pair = KeyPair { public: text(&pair.public_key)?, secret: text(&pair.secret_key)? };
    let failed =
        |path: &Path, e: std::io::Error| format!("{} cannot be written: {e}", path.display());
    let authorized = directory.join("authorized");
    fs::create_dir_all(&authorized).map_err(|e| failed(&authorized, e))?;
    let secret = directory.join("secret.key");
    let both = format!(
        "# rodgym secret key: keep it to yourself.\npublic = {}\nsecret = {}\n",
        pair.public, pair.secret
    );
    create(&secret, &both, true).map_err(|e| failed(&secret, e))?;
    let public = directory.join("public.key");
    let one = format!("# rodgym public key: give it away.\npublic = {}\n", pair.public);
    create(&public, &one, false).map_err(|e| failed(&public, e))?;
    Ok(pair)
}

/// Creates a file that must not exist yet.
fn create(path: &Path, text: &str, secret: bool) -> std::io::Result<()> {
    let mut options = fs::OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt;
        options.mode(if secret { 0o600 } else { 0o644 });
    }
    let _ = secret;
    options.open(path)?.write_all(text.as_bytes())
}

/// Reads the pair of a key directory.
///
/// # Errors
/// A missing or unreadable file, or one that others may read: a sentence.
pub fn load(directory: &Path) -> Result<KeyPair, String> {
    let path = directory.join("secret.key");
    refuse_if_readable_by_others(&path)?;
    let words = read(&path)?;
    let word = |name: &str| match words.get(name) {
        Some(key) if key.len() == 40 => Ok(key.clone()),
        _ => Err(format!("{} has no line '{name} = ' with 40 characters", path.display())),
    };
    Ok(KeyPair { public: word("public")?, secret: word("secret")? })
}

#[cfg(unix)]
fn refuse_if_readable_by_others(path: &Path) -> Result<(), String> {
    use std::os::unix::fs::PermissionsExt;
    let mode =
        fs::metadata(path).map_err(|e| format!("{}: {e}", path.display()))?.permissions().mode();
    if mode & 0o077 != 0 {
        let (path, mode) = (path.display(), mode & 0o777);
        return Err(format!("{path} has mode {mode:o}: others can read it; chmod 600 {path}"));
    }
    Ok(())
}

#[cfg(not(unix))]
fn refuse_if_readable_by_others(_: &Path) -> Result<(), String> {
    Ok(())
}

/// Reads `authorized/*.key`. A file that cannot be understood admits nobody and is reported.
pub fn authorized(directory: &Path) -> (HashMap<String, User>, Vec<String>) {
    let (mut users, mut problems) = (HashMap::new(), Vec::new());
    let folder = directory.join("authorized");
    let entries = match fs::read_dir(&folder) {
        Ok(entries) => entries,
        Err(e) => return (users, vec![format!("{}: {e}", folder.display())]),
    };
    let paths = entries.filter_map(|entry| entry.ok().map(|entry| entry.path()));
    for path in paths.filter(|path| path.extension().is_some_and(|e| e == "key")) {
        match user(&path) {
            Ok((name, user)) => {
                users.insert(name, user);
            }
            Err(problem) => problems.push(problem),
        }
    }
    (users, problems)
}

fn user(path: &Path) -> Result<(String, User), String> {
    let shown = path.display();
    let name = path.file_stem().and_then(|s| s.to_str()).unwrap_or_default();
    let good = |b: u8| b.is_ascii_alphanumeric() || b"._-".contains(&b);
    if name.is_empty() || name.len() > 64 || !name.bytes().all(good) {
        return Err(format!("{shown}: a user's name has letters, digits, '.', '_' and '-' only"));
    }
    let words = read(path)?;
    let public = words.get("public").filter(|key| key.len() == 40).cloned();
    let public =
        public.ok_or_else(|| format!("{shown} has no line 'public = ' with 40 characters"))?;
    if let Some(word) = words.keys().find(|w| !["public", "sessions", "envs"].contains(&w.as_str()))
    {
        return Err(format!("{shown}: unknown word '{word}'; known are public, sessions, envs"));
    }
    let number = |word: &str| match words.get(word) {
        None => Ok(None),
        Some(text) => match text.parse() {
            Ok(number) => Ok(Some(number)),
            Err(_) => Err(format!("{shown}: {word} = {text} is not a whole number")),
        },
    };
    let limits = UserLimits { sessions: number("sessions")?, envs: number("envs")? };
    Ok((name.into(), User { public, limits }))
}

/// Lines `word = value`; `#` begins a comment line (inside a line it may belong to a key).
fn read(path: &Path) -> Result<HashMap<String, String>, String> {
    let shown = path.display();
    let text = fs::read_to_string(path).map_err(|e| format!("{shown}: {e}"))?;
    let mut words = HashMap::new();
    for line in text.lines().map(str::trim) {
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let Some((word, value)) = line.split_once('=') else {
            return Err(format!("{shown}: '{line}' is not a line 'word = value'"));
        };
        words.insert(word.trim().into(), value.trim().into());
    }
    Ok(words)
}
