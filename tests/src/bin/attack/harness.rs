//! Cases one by one, in processes that may panic, hang or crash, and what came of them.

use std::{
    any::Any,
    fmt::Write as _,
    io::{BufRead as _, BufReader, Read as _, Seek as _},
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
    process::{Child, Command, ExitCode, ExitStatus, Stdio},
    sync::{
        Mutex,
        atomic::{AtomicUsize, Ordering},
        mpsc,
    },
    thread,
    time::{Duration, Instant},
};

/// A case that takes longer hangs.
const CASE: Duration = Duration::from_secs(90);
/// A run of the program that takes longer hangs.
const RUN: Duration = Duration::from_secs(60);
/// Cases at a time.
const WORKERS: usize = 2;
/// What is not tried by then counts as wrong: an attack that nobody waits for finds nothing.
const ALL: Duration = Duration::from_secs(580);
/// How much of an error is told.
const TOLD: usize = 600;

/// What came of a try, unless it was wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Good {
    /// The right answer.
    Right,
    /// An error with a message that says what is expected.
    Refused,
}

/// What came of a try; wrong is what panicked, hung, crashed or gave an unexpected answer.
pub(crate) type Judged = Result<Good, String>;

/// What came of tries.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    right: u64,
    refused: u64,
    wrong: Vec<String>,
}

impl Tally {
    /// Tries something that may panic.
    pub(crate) fn attempt(&mut self, what: &str, work: impl FnOnce() -> Judged) {
        match catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| Err(panicked(panic.as_ref()))) {
            Ok(Good::Right) => self.right += 1,
            Ok(Good::Refused) => self.refused += 1,
            Err(why) => self.wrong.push(if what.is_empty() { why } else { format!("{what}: {why}") }),
        }
    }

    fn add(&mut self, other: Self) {
        self.right += other.right;
        self.refused += other.refused;
        self.wrong.extend(other.wrong);
    }
}

fn panicked(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
    format!("panicked: {}", text.unwrap_or("without words"))
}

/// Something to try, perhaps in many ways.
pub(crate) struct Case {
    pub(crate) name: String,
    run: Box<dyn Fn(&mut Tally)>,
}

impl Case {
    pub(crate) fn many(name: impl Into<String>, run: impl Fn(&mut Tally) + 'static) -> Self {
        Self { name: name.into(), run: Box::new(run) }
    }

    pub(crate) fn one(name: impl Into<String>, run: impl Fn() -> Judged + 'static) -> Self {
        Self::many(name, move |tally| tally.attempt("", &run))
    }
}

/// Runs every second case from `first` on, and tells what came of each on a line of its own.
pub(crate) fn work(cases: &[Case], first: usize) {
    for (number, case) in cases.iter().enumerate().skip(first).step_by(WORKERS) {
        println!("begin {number}");
        let mut tally = Tally::default();
        if let Err(panic) = catch_unwind(AssertUnwindSafe(|| (case.run)(&mut tally))) {
            tally.wrong.push(panicked(panic.as_ref()));
        }
        for why in &tally.wrong {
            println!("wrong {}", why.replace('\n', " | "));
        }
        println!("end {} {}", tally.right, tally.refused);
    }
}

/// One worker after the other, from one case on, until all are done.
struct Supervisor<'a> {
    cases: usize,
    names: &'a [String],
    start: Instant,
}

impl Supervisor<'_> {
    fn watch(&self, mut first: usize, done: &(impl Fn(usize, Tally) + Sync)) {
        while first < self.cases {
            let mut child = Command::new(std::env::current_exe().expect("this program is a file"))
                .args(["--worker", &first.to_string()])
                .args(self.names)
                .stdout(Stdio::piped())
                .stderr(Stdio::null())
                .spawn()
                .expect("this program starts");
            let (send, lines) = mpsc::channel();
            let out = BufReader::new(child.stdout.take().expect("it is piped"));
            thread::spawn(move || out.lines().map_while(Result::ok).try_for_each(|line| send.send(line)));
            let mut tally = Tally::default();
            let why = loop {
                let left = ALL.saturating_sub(self.start.elapsed()).min(CASE);
                match lines.recv_timeout(left) {
                    Ok(line) => match line.split_once(' ') {
                        Some(("wrong", why)) => tally.wrong.push(why.to_owned()),
                        Some(("end", counts)) => {
                            let mut counts = counts.split(' ').map(|n| n.parse().expect("a count"));
                            (tally.right, tally.refused) =
                                (counts.next().unwrap_or(0), counts.next().unwrap_or(0));
                            done(first, std::mem::take(&mut tally));
                            first += WORKERS;
                        }
                        _ => {}
                    },
                    Err(mpsc::RecvTimeoutError::Timeout) => {
                        let _ = child.kill();
                        let _ = child.wait();
                        let late = self.start.elapsed() >= ALL;
                        break if late { "not tried in time" } else { "hung" }.to_owned();
                    }
                    Err(mpsc::RecvTimeoutError::Disconnected) => {
                        break child
                            .wait()
                            .map_or_else(|e| e.to_string(), |status| format!("crashed: {status}"));
                    }
                }
            };
            if first < self.cases {
                tally.wrong.push(why);
                done(first, tally);
                first += WORKERS;
            }
        }
    }
}

/// Runs all cases and counts what came of them.
pub(crate) fn supervise(cases: &[Case], names: &[String]) -> ExitCode {
    let start = Instant::now();
    let called: Vec<&str> = cases.iter().map(|case| case.name.as_str()).collect();
    let (total, told) = (Mutex::new(Tally::default()), AtomicUsize::new(0));
    let done = |number: usize, tally: Tally| {
        for why in &tally.wrong {
            let why: String = why.chars().take(TOLD).collect();
            println!("WRONG {}: {why}", called[number]);
        }
        total.lock().expect("nobody panics with it").add(tally);
        let told = told.fetch_add(1, Ordering::Relaxed) + 1;
        if told.is_multiple_of(100) {
            println!("{told} of {} cases, {} s", called.len(), start.elapsed().as_secs());
        }
    };
    let supervisor = Supervisor { cases: called.len(), names, start };
    thread::scope(|scope| {
        for first in 0..WORKERS {
            let (supervisor, done) = (&supervisor, &done);
            scope.spawn(move || supervisor.watch(first, done));
        }
    });
    let Tally { right, refused, wrong } = total.into_inner().expect("nobody panicked with it");
    let wrong = wrong.len() as u64;
    println!(
        "{} cases, {} s: tried {}, refused with a message {refused}, right {right}, wrong {wrong}",
        called.len(),
        start.elapsed().as_secs(),
        refused + right + wrong
    );
    if wrong > 0 || right + refused == 0 { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

/// The program, beside this one.
pub(crate) fn program() -> PathBuf {
    let here = std::env::current_exe().expect("this program is a file");
    here.with_file_name(format!("raykd{}", std::env::consts::EXE_SUFFIX))
}

/// The program in a folder, with words as arguments.
pub(crate) fn raykd(folder: &Path, line: &str) -> Command {
    let mut command = Command::new(program());
    command.args(line.split_whitespace()).current_dir(folder);
    command
}

/// What a run of the program left.
pub(crate) struct Ran {
    pub(crate) status: ExitStatus,
    pub(crate) err: String,
}

/// Starts a command whose messages go to a file, so that it never waits for a reader.
pub(crate) fn start(command: &mut Command) -> Running {
    let messages = tempfile::tempfile().expect("there is room for a file");
    let to = messages.try_clone().expect("a file");
    let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(to).spawn().expect("it starts");
    Running { child, messages }
}

/// A run of the program.
pub(crate) struct Running {
    pub(crate) child: Child,
    messages: std::fs::File,
}

impl Running {
    /// Waits for its end, or ends it.
    pub(crate) fn finish(mut self) -> Result<Ran, String> {
        let start = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().map_err(|e| e.to_string())? {
                break status;
            }
            if start.elapsed() > RUN {
                let _ = self.child.kill();
                let _ = self.child.wait();
                return Err("raykd hung".to_owned());
            }
            thread::sleep(Duration::from_millis(2));
        };
        let (mut file, mut bytes) = (self.messages, Vec::new());
        file.rewind().and_then(|()| file.read_to_end(&mut bytes)).expect("a file is read");
        Ok(Ran { status, err: String::from_utf8_lossy(&bytes).into_owned() })
    }
}

/// Runs a command to its end.
pub(crate) fn run(command: &mut Command) -> Result<Ran, String> {
    start(command).finish()
}

impl Ran {
    fn unexpected(&self, wanted: &str) -> String {
        let mut text = format!("{wanted} expected, but {}: ", self.status);
        let _ = write!(text, "{}", self.err.trim().chars().take(TOLD / 2).collect::<String>());
        text
    }

    /// Success.
    pub(crate) fn succeeded(&self) -> Judged {
        if self.status.success() { Ok(Good::Right) } else { Err(self.unexpected("success")) }
    }

    /// Success, or an error with a short message.
    pub(crate) fn either(&self) -> Judged {
        let spoken = self.err.contains("error: ") && !self.err.contains("panicked") && self.err.len() < 4000;
        match self.status.code() {
            Some(0) => Ok(Good::Right),
            Some(1 | 2) if spoken => Ok(Good::Refused),
            _ => Err(self.unexpected("success or a message")),
        }
    }
}

/// An error if something does not hold.
pub(crate) fn holds(it: bool, what: impl FnOnce() -> String) -> Result<(), String> {
    if it { Ok(()) } else { Err(what()) }
}
