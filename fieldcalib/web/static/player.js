// Frames for display: their state and picture together, fetched ahead while a clip plays.

import { get, pictureSource } from "./api.js";

const AHEAD = 4; // frames fetched at once while playing
const KEPT = 16;

/** Fetches frames, and keeps the last ones. */
export class FrameLoader {
  constructor(picture) {
    this.picture = picture;
    this.kept = new Map();
  }

  /** {state, loaded | null, failure | null} of a frame; a state that was kept may be old, unless `fresh`. */
  frame(number, { fresh = false } = {}) {
    if (fresh) this.kept.delete(number);
    let found = this.kept.get(number);
    if (!found) {
      found = this.fetch(number);
      found.catch(() => this.kept.delete(number));
    }
    this.kept.delete(number);
    this.kept.set(number, found);
    while (this.kept.size > KEPT) this.kept.delete(this.kept.keys().next().value);
    return found;
  }

  async fetch(number) {
    const state = await get(`api/frame/${number}`);
    if (state.problem) return { state, loaded: null, failure: state.problem };
    try {
      return { state, loaded: await this.picture.load(pictureSource(state)), failure: null };
    } catch {
      return { state, loaded: null, failure: "The picture could not be read." };
    }
  }

  forget() {
    this.kept.clear();
  }
}

/** Plays the frames of a clip at its rate, leaving out those that come too late. */
export class Player {
  constructor(loader, { show, onchange, onerror }) {
    this.loader = loader;
    this.listeners = { show, onchange, onerror };
    this.playing = false;
  }

  toggle(from, count, rate) {
    if (this.playing) this.stop();
    else this.play(from >= count - 1 ? 0 : from, count, rate);
  }

  stop() {
    this.playing = false;
    this.listeners.onchange(false);
  }

  async play(from, count, rate) {
    this.playing = true;
    this.listeners.onchange(true);
    let [begun, first, number] = [performance.now(), from, from];
    while (this.playing && number < count) {
      for (let k = 1; k <= AHEAD && number + k < count; k++) this.loader.frame(number + k).catch(() => {});
      try {
        const found = await this.loader.frame(number);
        if (!this.playing) return;
        this.listeners.show(number, found);
      } catch (error) {
        this.listeners.onerror(error);
        return this.stop();
      }
      await new Promise(requestAnimationFrame);
      const due = first + Math.floor(((performance.now() - begun) / 1000) * rate);
      if (due <= number) await new Promise((resolve) => setTimeout(resolve, (1000 * (number + 1 - first)) / rate - (performance.now() - begun)));
      else if (due > number + AHEAD) [begun, first] = [performance.now() - 1000 / rate, number]; // too slow for the rate: slower, but every frame in reach
      number = Math.min(Math.max(number + 1, Math.min(due, number + AHEAD)), count);
    }
    this.stop();
    return undefined;
  }
}
