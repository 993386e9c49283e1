// ZMTP 3.0 over TCP, mechanism NULL: just enough of ZeroMQ for one DEALER that talks to one ROUTER.
// No dependencies. (RFC 23: https://rfc.zeromq.org/spec/23/)

import net from "node:net";

const MORE = 1, LONG = 2, COMMAND = 4;

/** A greeting of 64 bytes: signature, version 3.0, mechanism, client. */
function greeting() {
  const bytes = Buffer.alloc(64);
  bytes[0] = 0xff;
  bytes[9] = 0x7f;
  bytes[10] = 3;
  bytes.write("NULL", 12, "ascii");
  return bytes;
}

function frame(flags, body) {
  if (body.length < 256) return Buffer.concat([Buffer.from([flags, body.length]), body]);
  const head = Buffer.alloc(9);
  head[0] = flags | LONG;
  head.writeBigUInt64BE(BigInt(body.length), 1);
  return Buffer.concat([head, body]);
}

function ready() {
  const name = Buffer.from("\x05READY\x0bSocket-Type\x00\x00\x00\x06DEALER", "latin1");
  return frame(COMMAND, name);
}

/** Connects; `onMessage` gets each whole message as a list of frames, `onClose` why it ended. */
export function connect(host, port, onMessage, onClose) {
  const socket = net.connect({ host, port, noDelay: true });
  let buffer = Buffer.alloc(0), greeted = false, message = [];
  // Messages wait for the other side's READY: before it they break the handshake.
  let waiting = [];
  socket.write(Buffer.concat([greeting(), ready()]));
  socket.on("error", (error) => onClose(error.message));
  socket.on("close", () => onClose("the server closed the connection"));
  socket.on("data", (data) => {
    buffer = Buffer.concat([buffer, data]);
    if (!greeted) {
      if (buffer.length < 64) return;
      const mechanism = buffer.toString("ascii", 12, 32).replace(/\0+$/, "");
      if (buffer[0] !== 0xff || buffer[10] < 3 || mechanism !== "NULL") {
        return socket.destroy(new Error(`not a ZMTP 3 peer with mechanism NULL: '${mechanism}'`));
      }
      buffer = buffer.subarray(64);
      greeted = true;
    }
    for (;;) {
      const head = buffer[0] & LONG ? 9 : 2;
      if (buffer.length < head) return;
      const size = buffer[0] & LONG ? Number(buffer.readBigUInt64BE(1)) : buffer[1];
      if (buffer.length < head + size) return;
      const flags = buffer[0], body = buffer.subarray(head, head + size);
      buffer = buffer.subarray(head + size);
      if (flags & COMMAND) {
        answer(body);
      } else {
        message.push(Buffer.from(body));
        if (!(flags & MORE)) {
          const whole = message;
          message = [];
          onMessage(whole);
        }
      }
    }
  });

  /** READY ends the handshake. PING carries a time-to-live (2 bytes) and a context that PONG gives back. */
  function answer(command) {
    const name = command.toString("latin1", 1, 1 + command[0]);
    if (name === "READY" && waiting) {
      waiting.forEach((bytes) => socket.write(bytes));
      waiting = null;
    } else if (name === "PING") {
      socket.write(frame(COMMAND, Buffer.concat([Buffer.from("\x04PONG"), command.subarray(7)])));
    }
  }

  return {
    send(frames) {
      const last = frames.length - 1;
      const bytes = Buffer.concat(frames.map((body, i) => frame(i < last ? MORE : 0, body)));
      if (waiting) waiting.push(bytes);
      else socket.write(bytes);
    },
    close() {
      socket.removeAllListeners("close");
      socket.destroy();
    },
  };
}
