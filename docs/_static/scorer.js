// Sphinx's own scores, with the pages that come from data (problems, claims) last.
const FROM_DATA = /^(problems|claims)\/(?!index)/;
var Scorer = {
  score: (result) => {
    const [docname, , , , score] = result;
    return FROM_DATA.test(docname) ? score - 100 : score;
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
