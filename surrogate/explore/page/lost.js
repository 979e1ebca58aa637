// A program that stops, is late, or comes back: what the page says meanwhile, and how it goes on.

import { element } from "../web/elements.js";
import * as connection from "./connection.js";

const AGAIN = 350; // milliseconds between questions for the facts

export class Lost {
  constructor(explorer) {
    this.explorer = explorer;
    this.box = element("p", { id: "lost", role: "alert", hidden: true });
  }

  listen() { connection.listen({ lost: reason => this.lose(reason), back: () => this.findAgain(), late: seconds => this.wait(seconds) }); }

  lose(reason) {
    this.box.textContent = `The explorer has stopped. ${reason || "Start it again on its machine: this page waits for it, and keeps what it shows."}`;
    this.box.hidden = false;
    document.body.classList.add("is-lost");
  }

  /** Say for how long there has been no answer; 0 when one came. */
  wait(seconds) {
    if (document.body.classList.contains("is-lost")) return;
    this.box.textContent = `No answer for ${seconds} s: the explorer is busy or hangs, or the line is down. This page waits for it.`;
    this.box.hidden = !seconds;
  }

  /** The program is back: the same run goes on where it was, another one is shown anew. */
  async findAgain() {
    const facts = await firstFacts();
    if (JSON.stringify(facts) !== JSON.stringify(this.explorer.facts)) {
      this.explorer.writeAddress();
      location.reload();
      return;
    }
    this.box.hidden = true;
    document.body.classList.remove("is-lost");
    this.explorer.stream.settle();
  }
}

/** The facts, as soon as the program can be asked. */
export async function firstFacts() {
  for (;;) {
    try {
      return await connection.facts();
    } catch (error) {
      if (!(error instanceof connection.Gone)) throw error;
      await new Promise(resolve => { setTimeout(resolve, AGAIN); });
    }
  }
}
