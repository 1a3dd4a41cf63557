// @ts-check
// The websocket: requests and their answers, of each slot one at a time and then the newest.

import { packetOf } from "./viewport/packets.js";

export class Link {
  constructor(tell) {
    this.tell = tell;
    this.next = 1;
    this.open = new Map();
    this.slots = new Map();
    this.wait = 250;
    this.connect();
  }

  connect() {
    this.socket = new WebSocket(`ws://${location.host}/talk`);
    this.socket.binaryType = "arraybuffer";
    /** @type {Promise<void>} */
    this.ready = new Promise((done) => {
      this.socket.onopen = () => {
        this.wait = 250;
        this.tell("", true);
        done();
      };
    });
    this.socket.onmessage = ({ data }) =>
      this.receive(typeof data === "string" ? JSON.parse(data) : packetOf(data));
    this.socket.onclose = () => {
      const left = [...this.open.values()];
      this.open.clear();
      this.slots.clear();
      for (const each of left) each.fail(new Error("the server does not answer"));
      this.tell("The server does not answer; trying again.", false);
      setTimeout(() => this.connect(), this.wait);
      this.wait = Math.min(4000, this.wait * 2);
    };
  }

  receive(answer) {
    const asked = this.open.get(answer.id);
    if (!asked) return;
    if (answer.progress) {
      asked.progress?.(answer.progress);
      return;
    }
    this.open.delete(answer.id);
    if (answer.error !== undefined) asked.fail(new Error(answer.error));
    else asked.done(answer);
  }

  // Ask, and resolve with the answer; errors are those of the server.
  async ask(request, progress) {
    await this.ready;
    const id = this.next++;
    return new Promise((done, fail) => {
      this.open.set(id, { done, fail, progress });
      this.socket.send(JSON.stringify({ slot: `once/${id}`, ...request, id }));
    });
  }

  // Ask in a slot: while one request of it is open, only the newest other waits; those between
  // resolve with null.
  newest(slot, request) {
    return new Promise((done, fail) => {
      const state = this.slots.get(slot) ?? { busy: false, waiting: null };
      this.slots.set(slot, state);
      state.waiting?.done(null);
      state.waiting = { request, done, fail };
      if (!state.busy) this.proceed(slot, state);
    });
  }

  async proceed(slot, state) {
    const { request, done, fail } = state.waiting;
    state.waiting = null;
    state.busy = true;
    try {
      done(await this.ask({ ...request, slot }));
    } catch (error) {
      fail(error);
    }
    state.busy = false;
    if (state.waiting) this.proceed(slot, state);
  }
}
