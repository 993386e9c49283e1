// A client of the remote protocol (docs/protocol.md) without dependencies, for servers without keys.
//
//   const client = new Client("127.0.0.1", 5555);
//   const env = await client.make("rodgym/PendulumSwingUp-v0", { num_envs: 2 });
//   let { obs } = await env.reset(1);
//   ({ obs, reward } = await env.step(new Float32Array([0.5, -0.5])));

import { randomBytes } from "node:crypto";
import { decode, encode } from "./msgpack.mjs";
import { connect } from "./zmtp.mjs";

export const FLAGS = { terminated: 1, truncated: 2, stepped: 4, began: 8, solverFailure: 16, final: 32 };

const ARRAYS = {
  "<f4": Float32Array, "<f8": Float64Array, "<u4": Uint32Array, "<u8": BigUint64Array,
  "|u1": Uint8Array, "|b1": Uint8Array,
};

/** Frames of a request; `arrays` maps a name to [dtype, shape, typed array]. */
export function pack(header, arrays = {}) {
  const arr = Object.entries(arrays).map(([name, [dtype, shape]]) => [name, dtype, shape]);
  const frames = Object.values(arrays).map(([, , data]) =>
    Buffer.from(data.buffer, data.byteOffset, data.byteLength));
  return [encode({ v: 1, ...header, arr }), ...frames];
}

/** Header and arrays of a message: typed arrays by name, each with its `shape`. */
export function unpack(frames) {
  const header = decode(frames[0]), arrays = {};
  const arr = header.arr ?? [];
  if (arr.length !== frames.length - 1) throw new Error("frames and arrays differ in number");
  arr.forEach(([name, dtype, shape], i) => {
    const Type = ARRAYS[dtype];
    const count = shape.reduce((a, b) => a * b, 1);
    if (!Type || count * Type.BYTES_PER_ELEMENT !== frames[i + 1].length) {
      throw new Error(`array '${name}' (${dtype} [${shape}]) does not fit its frame`);
    }
    // A copy of its own: a frame may begin anywhere, a typed array may not.
    const bytes = new Uint8Array(frames[i + 1]);
    arrays[name] = Object.assign(new Type(bytes.buffer, 0, count), { shape });
  });
  return { header, arrays };
}

/** A refusal of the server, or no answer. */
export class RemoteError extends Error {
  constructor({ code, msg, retry = "never", after_ms }) {
    super(`${code}: ${msg}`);
    Object.assign(this, { code, retry, after_ms });
  }
}

/** One request at a time; sends again over a new connection until answered or out of time. */
export class Client {
  #wire = null;
  #rid = 0;
  #waiting = null;
  #lastSeen = "not connected yet";

  constructor(host, port, { timeout = 60000, attempt = 2000 } = {}) {
    Object.assign(this, { host, port, timeout, attempt, resent: 0 });
  }

  async request(header, arrays) {
    const rid = ++this.#rid, frames = pack({ ...header, rid }, arrays);
    const end = Date.now() + this.timeout;
    for (;;) {
      const reply = await this.#once(frames, rid, Math.min(this.attempt, end - Date.now()));
      if (reply?.header.ok) return reply;
      const error = reply?.header.err;
      if (error && error.retry !== "same") throw new RemoteError(error);
      if (Date.now() >= end) {
        const msg = `no answer from ${this.host}:${this.port}; last seen: ${this.#lastSeen}`;
        throw new RemoteError(error ?? { code: "timeout", msg });
      }
      if (!error) {
        this.close();
        this.resent += 1;
      }
      await new Promise((go) => setTimeout(go, error?.after_ms ?? 10 + 40 * Math.random()));
    }
  }

  #once(frames, rid, time) {
    return new Promise((resolve) => {
      const timer = setTimeout(() => done(null), time);
      const done = (reply) => {
        clearTimeout(timer);
        this.#waiting = null;
        resolve(reply);
      };
      this.#waiting = { rid, done };
      this.#wire ??= this.#open();
      this.#wire.send(frames);
    });
  }

  #open() {
    const wire = connect(this.host, this.port, (message) => {
      const reply = unpack(message);
      this.#lastSeen = "connected";
      // Replies to requests that we sent twice come twice.
      if (this.#waiting && [this.#waiting.rid, 0].includes(reply.header.rid)) {
        this.#waiting.done(reply);
      }
    }, (reason) => {
      this.#lastSeen = reason;
      if (wire === this.#wire) {
        this.#wire = null;
        this.#waiting?.done(null);
      }
    });
    return wire;
  }

  async make(id, parameters = {}) {
    const nonce = randomBytes(16).toString("hex");
    const { header } = await this.request({ op: "make", p: { id, nonce, window: 1, ...parameters } });
    return new Session(this, header.p);
  }

  close() {
    this.#wire?.close();
    this.#wire = null;
  }
}

/** A batch of environments on the server. */
export class Session {
  #seq = 0;

  constructor(client, about) {
    Object.assign(this, { client, about, sid: about.sid });
  }

  /** A changing call: numbered, so that it is carried out once however often it is sent. */
  async change(op, p, arrays) {
    const seq = this.#seq + 1;
    const reply = await this.client.request({ op, sid: this.sid, seq, p }, arrays);
    this.#seq = seq;
    return reply.arrays;
  }

  reset(seed) {
    return this.change("reset", seed === undefined ? {} : { seed });
  }

  step(actions) {
    const shape = [this.about.num_envs, this.about.spec.action.low.length];
    return this.change("step", {}, { action: ["<f4", shape, Float32Array.from(actions)] });
  }

  async getState() {
    return (await this.client.request({ op: "get_state", sid: this.sid })).arrays;
  }

  setState({ sizes, data }) {
    return this.change("set_state", {}, {
      sizes: ["<u4", [sizes.length], sizes],
      data: ["|u1", [data.length], data],
    });
  }

  async close() {
    await this.client.request({ op: "close", sid: this.sid });
  }
}
