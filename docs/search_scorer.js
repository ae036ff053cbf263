// What a user reads comes before what changed and what developers read. The numbers below `score` are Sphinx's own.
var Scorer = {
  score: ([docname, title, anchor, description, score]) => {
    const weights = [[/^(guide|tutorials)\//, 8], [/^(methods|api)\//, 2], [/^(changelog|contributing|planted_faults)$/, -12]];
    return score + weights.reduce((sum, [pages, weight]) => sum + (pages.test(docname) ? weight : 0), 0);
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: {0: 15, 1: 5, 2: -5},
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
