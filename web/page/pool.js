// Workers that the page asks, and their answers.

/** One worker, asked by name. Answers come in the order of the questions. */
class Asked {
  constructor() {
    this.worker = new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
    this.waiting = new Map();
    this.next = 0;
    this.worker.onmessage = ({ data: { id, result, error } }) => {
      const [done, failed] = this.waiting.get(id);
      this.waiting.delete(id);
      error === undefined ? done(result) : failed(new Error(error));
    };
    this.worker.onerror = ({ message }) => {
      for (const [, failed] of this.waiting.values()) failed(new Error(message ?? "a worker stopped"));
      this.waiting.clear();
    };
  }

  ask(call, ...given) {
    return new Promise((...both) => {
      this.waiting.set(this.next, both);
      this.worker.postMessage({ id: this.next++, call, given });
    });
  }
}

/** As many workers as asked for. The module is compiled once. */
export class Pool {
  static async of(count) {
    const pool = new Pool();
    pool.workers = Array.from({ length: count }, () => new Asked());
    const module = await WebAssembly.compileStreaming(fetch(new URL("../pkg/raykd_bg.wasm", import.meta.url)));
    [pool.choices] = await pool.all("start", module);
    return pool;
  }

  /** Asks the first worker. */
  ask(call, ...given) {
    return this.workers[0].ask(call, ...given);
  }

  /** Asks all. If one fails, the others have answered as well. */
  async all(call, ...given) {
    const answers = await Promise.allSettled(this.workers.map((worker) => worker.ask(call, ...given)));
    const failed = answers.find(({ status }) => status === "rejected");
    if (failed) throw failed.reason;
    return answers.map(({ value }) => value);
  }

  /** Gives each worker the next job as soon as it is free, while `going()`. */
  async share(jobs, going, take) {
    let next = 0;
    const work = async (worker) => {
      while (next < jobs.length && going()) {
        const job = jobs[next++];
        take(job, await worker.ask(...job.ask));
      }
    };
    await Promise.all(this.workers.map(work));
    return next === jobs.length && going();
  }
}
