// @ts-check
// The websocket: requests and their answers, of each slot one at a time and then the newest.

import { parsePacket } from "./viewport/packets.js";

export class Link {
  constructor(say) {
    this.say = say;
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
    this.ready = new Promise((resolve) => {
      this.socket.onopen = () => {
        this.wait = 250;
        this.say("", true);
        resolve();
      };
    });
    this.socket.onmessage = ({ data }) =>
      this.receive(typeof data === "string" ? JSON.parse(data) : parsePacket(data));
    this.socket.onclose = () => {
      const requests = [...this.open.values()];
      this.open.clear();
      this.slots.clear();
      for (const request of requests) request.fail(new Error("the server does not answer"));
      this.say("The server does not answer; trying again.", false);
      setTimeout(() => this.connect(), this.wait);
      this.wait = Math.min(4000, this.wait * 2);
    };
  }

  receive(answer) {
    const request = this.open.get(answer.id);
    if (!request) return;
    if (answer.progress) {
      request.progress?.(answer.progress);
      return;
    }
    this.open.delete(answer.id);
    if (answer.error !== undefined) request.fail(new Error(answer.error));
    else request.done(answer);
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
