// A robot moved by hand: sliders ask the Python behind the page, which closes the loops.

class Hand {
  constructor(section, content) {
    this.content = content;
  }
}
