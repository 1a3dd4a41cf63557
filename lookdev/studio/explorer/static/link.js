// @ts-check
// The websocket to the server, which answers requests. A slot names what an answer updates, such as
// a plot. It has one request at a time; of the others, only the newest follows.

import { parsePacket } from "./viewport/packets.js";

export class Link {
  /** `report` is called with a message, and whether it is good, when the connection changes. */
  constructor(report) {
    this.report = report;
    this.nextId = 1;
    this.requests = new Map(); // those without an answer, by id
    this.slots = new Map(); // {busy, waiting} by the name of the slot
    this.retryDelay = 250; // milliseconds until the page reconnects
    this.connect();
  }

  connect() {
    this.socket = new WebSocket(`ws://${location.host}/talk`);
    this.socket.binaryType = "arraybuffer";
    /** @type {Promise<void>} */
    this.ready = new Promise((resolve) => {
      this.socket.onopen = () => {
        this.retryDelay = 250;
        this.report("", true);
        resolve();
      };
    });
    this.socket.onmessage = ({ data }) =>
      this.receive(typeof data === "string" ? JSON.parse(data) : parsePacket(data));
    this.socket.onclose = () => {
      const requests = [...this.requests.values()];
      this.requests.clear();
      this.slots.clear();
      for (const request of requests) request.reject(new Error("the server does not answer"));
      this.report("The server does not answer; trying again.", false);
      setTimeout(() => this.connect(), this.retryDelay);
      this.retryDelay = Math.min(4000, this.retryDelay * 2);
    };
  }

  receive(answer) {
    const request = this.requests.get(answer.id);
    if (!request) return;
    if (answer.progress) {
      request.progress?.(answer.progress);
      return;
    }
    this.requests.delete(answer.id);
    if (answer.error !== undefined) request.reject(new Error(answer.error));
    else request.resolve(answer);
  }

  // Return the server's answer to a request; throws the server's errors. `progress` is called with
  // reports before the answer.
  async ask(request, progress) {
    await this.ready;
    const id = this.nextId++;
    return new Promise((resolve, reject) => {
      this.requests.set(id, { resolve, reject, progress });
      this.socket.send(JSON.stringify({ slot: `once/${id}`, ...request, id }));
    });
  }

  // Return the server's answer to a request of a slot. While the slot has an open request, only its
  // newest other request waits; earlier ones resolve with null.
  askNewest(slot, request) {
    return new Promise((resolve, reject) => {
      const state = this.slots.get(slot) ?? { busy: false, waiting: null };
      this.slots.set(slot, state);
      state.waiting?.resolve(null);
      state.waiting = { request, resolve, reject };
      if (!state.busy) this.sendNext(slot, state);
    });
  }

  /** Send the waiting request of a slot, and after its answer the next one, if there is any. */
  async sendNext(slot, state) {
    const { request, resolve, reject } = state.waiting;
    state.waiting = null;
    state.busy = true;
    try {
      resolve(await this.ask({ ...request, slot }));
    } catch (error) {
      reject(error);
    }
    state.busy = false;
    if (state.waiting) this.sendNext(slot, state);
  }
}
