// Questions of which only the newest counts: one is asked at a time, and of those that come meanwhile the last comes next.

export class Newest {
  /** `ask(question)` resolves to an answer, `take(answer, question)` uses it, `fail(error, question)` hears why there is none. */
  constructor(ask, take, fail) {
    Object.assign(this, { ask, take, fail, next: null, isAsking: false });
  }

  /** Ask this, after what is being asked. */
  async wish(question) {
    this.next = question;
    if (this.isAsking) return;
    this.isAsking = true;
    while (this.next) {
      const asked = this.next;
      this.next = null;
      try {
        this.take(await this.ask(asked), asked);
      } catch (error) {
        this.fail(error, asked);
      }
    }
    this.isAsking = false;
  }

  /** What has not been asked yet need not be. */
  drop() { this.next = null; }
}
